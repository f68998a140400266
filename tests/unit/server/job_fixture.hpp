#pragma once

#include "body_in_memory.hpp"
#include "service_fixture.hpp"
#include "support/stored_packages.hpp"
#include "support/tar_bytes.hpp"

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>

namespace stillmap::server {

/// A cloud as far as its header goes.
inline std::string pcd(const std::string& points) {
  return "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 9\nHEIGHT 1\nDATA binary\n" +
         points;
}
inline constexpr const char* kPly =
    "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
    "property float z\nend_header\n1 2 3\n";

/// A mapper that ends so.
inline constexpr const char* kMeetsAFullDisk =
    "echo x >> $work/tries; [ $(wc -l < $work/tries) -gt 4 ] && publish && exit 0;"
    " echo 'stillmap: /x: No space left on device'; exit 3";

/// A service with a script in place of the mapper, and one complete drive of `town`.
class JobTest : public ServiceTest {
 protected:
  JobTest() { test::write_package(scripts_.path() / "package", 7); }

  /// @param body  of the script, for all but `--estimate`. It has `$out`, `$work`, `$report`, and
  /// the functions `publish` and `say FRACTION STAGE`.
  void start_with(const std::string& body, const std::string& estimate = "1000") {
    write_mapper(body, estimate);
    start();
    make_drive();
  }
  void write_mapper(const std::string& body, const std::string& estimate = "1000") {
    mapper_ = scripts_.path() / "mapper";
    const std::string report = R"({"verdict": "pass", "reasons": [], "figures": {"new_lost": 0}})";
    std::ofstream script(mapper_.string() + ".new");
    script
        << "#!/bin/sh\n"
        << "while [ $# -gt 0 ]; do case $1 in --output) out=$2;; --work) work=$2;;"
        << " --json=*) report=${1#--json=};; --gate) gate=$2;; --edits) edits=$2;;"
        << " --estimate) printf '{\\n\"package_bytes\": " << estimate
        << ", \"work_bytes\": 5}\\n'; exit 0;; esac; shift; done\n"
        << "say() { printf '{\"stage\":\"%s\",\"fraction\":%s,\"eta_s\":2.5}\\n' \"$2\" $1 >&3; }\n"
        << "publish() { cp -r " << (scripts_.path() / "package").string()
        << " $out; [ -z \"$report\" ] || printf '%s' '" << report << "' > $report; }\n"
        << "[ -z \"$work\" ] || mkdir -p $work\n"
        << body << "\n";
    script.close();
    std::filesystem::permissions(mapper_.string() + ".new", std::filesystem::perms::owner_all);
    std::filesystem::rename(mapper_.string() + ".new", mapper_);
  }

  HttpResponse send(const std::string& method, const std::string& path,
                    const std::string& json = {}, const std::string& idempotency_key = {}) const {
    HttpRequest asked = request(method, path);
    asked.headers["content-type"] = "application/json";
    if (!idempotency_key.empty()) asked.headers["idempotency-key"] = idempotency_key;
    asked.body = json;
    return service_->handle(asked);
  }
  HttpResponse put(const std::string& path, const std::string& bytes,
                   const std::string& type = {}) const {
    HttpRequest asked = request("PUT", path);
    asked.headers["content-type"] = type;
    BodyInMemory stream(bytes);
    asked.stream = &stream;
    return service_->handle(asked);
  }
  /// @return its id.
  int make_drive() const {
    const std::string tar = test::tar_file("a/0.bin", std::string(64, '\x3f')) + test::tar_end();
    const int id = body(send("POST", "/v1/maps/town/drives"))["id"];
    const std::string path = "/v1/maps/town/drives/" + std::to_string(id);
    EXPECT_EQ(put(path + "/parts/1", tar).status, 201);
    EXPECT_EQ(send("POST", path + "/complete").status, 200);
    return id;
  }
  /// @return the job's path.
  std::string rebuild(const std::string& json = R"({"drives": [1]})") const {
    const HttpResponse response = send("POST", "/v1/maps/town/rebuild", json);
    EXPECT_EQ(response.status, 202) << response.body;
    if (response.status != 202) return "/v1/jobs/0";
    return "/v1/jobs/" + std::to_string(body(response)["id"].get<int>());
  }
  template <typename Holds>
  nlohmann::json wait(const std::string& job, Holds&& holds) const {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    nlohmann::json found;
    do {
      found = body(get(job));
      if (holds(found)) return found;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    } while (std::chrono::steady_clock::now() < end);
    ADD_FAILURE() << "waited in vain: " << found.dump();
    return found;
  }
  nlohmann::json wait_for_end(const std::string& job) const {
    return wait(job, [](const nlohmann::json& found) {
      return found["status"] != "enqueued" && found["status"] != "processing";
    });
  }
  nlohmann::json wait_for_stage(const std::string& job, const std::string& stage) const {
    return wait(job, [&](const nlohmann::json& found) {
      return found["status"] == "processing" && found["stage"] == stage;
    });
  }
  std::string log_of(const std::string& job) const {
    const HttpResponse response = get(job + "/log");
    if (!response.source) return {};
    std::string text(response.source->size(), '\0');
    response.source->read(0, text);
    return text;
  }
  std::filesystem::path job_folder(int id) const {
    return store_.folder().path() / "jobs" / std::to_string(id);
  }

  /// Soon after the job has ended nothing is left of its work.
  void expect_cleared(int id) const {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    const std::filesystem::path scratch = job_folder(id) / "scratch";
    while (std::filesystem::exists(scratch) && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_FALSE(std::filesystem::exists(scratch));
  }

  test::TemporaryFolder scripts_;
};

}  // namespace stillmap::server
