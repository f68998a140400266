#include <gmock/gmock.h>

#include "http/content_digest.hpp"
#include "job_fixture.hpp"
#include "support/store_contents.hpp"

namespace stillmap::server {
namespace uploads_test {

using nlohmann::json;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::Pair;

class Uploads : public JobTest {
 protected:
  static constexpr const char* kUploads = "/v1/maps/town/uploads";

  Uploads()
      : digest_(test::write_package(scripts_.path() / "other", 9)),
        tar_(test::tar_of(scripts_.path() / "other", "") + test::tar_end()) {}

  json opened(const std::string& version, const std::string& type = "application/x-tar",
              int status = 201) const {
    const HttpResponse made =
        send("POST", kUploads, json{{"version", version}, {"content_type", type}}.dump());
    EXPECT_EQ(made.status, status) << made.body;
    return body(made);
  }
  /// @return its path.
  static std::string path_of(const json& upload) {
    return std::string(kUploads) + "/" + std::to_string(upload["id"].get<int>());
  }
  /// Opens one and sends these bytes as two parts, the second one first.
  std::string filled(const std::string& version, const std::string& bytes,
                     const std::string& type = "application/x-tar") const {
    const std::string path = path_of(opened(version, type));
    const std::size_t half = bytes.size() / 2;
    EXPECT_EQ(put(path + "/parts/2", bytes.substr(half)).status, 201);
    EXPECT_EQ(put(path + "/parts/1", bytes.substr(0, half)).status, 201);
    return path;
  }
  bool has_bytes(const std::string& path) const {
    return std::filesystem::exists(store_.folder().path() / "drives" /
                                   path.substr(path.rfind('/') + 1));
  }

  std::string digest_, tar_;
};

TEST_F(Uploads, PackageBecomesAVersionWhenItsPartsAreThere) {
  start();
  const HttpResponse made =
      send("POST", kUploads, R"({"version": "v2", "content_type": "application/x-tar"})");
  ASSERT_EQ(made.status, 201) << made.body;
  EXPECT_THAT(made.headers, Contains(Pair("Location", "/v1/maps/town/uploads/1")));
  EXPECT_EQ(body(made)["status"], "open");
  EXPECT_EQ(body(made)["version"], "v2");
  EXPECT_FALSE(body(made).contains("name"));
  const std::string path = path_of(body(made));
  EXPECT_EQ(put(path + "/parts/2", tar_.substr(700)).status, 201);
  const json missing = body(send("POST", path + "/complete"));
  EXPECT_EQ(missing["code"], "PartsMissing");
  EXPECT_EQ(missing["detail"], "upload 1 has 1 parts up to number 2: send the missing ones");
  EXPECT_EQ(put(path + "/parts/1", tar_.substr(0, 700)).status, 201);
  EXPECT_EQ(put(path + "/parts/1", tar_.substr(0, 700)).status, 200);
  EXPECT_EQ(body(put(path + "/parts/1", "other"))["code"], "OtherDigest");
  const json half = body(get(path));
  EXPECT_EQ(half["bytes"], tar_.size());
  EXPECT_EQ(half["parts"].size(), 2U);
  EXPECT_EQ(get("/v1/maps/town/versions/v2").status, 404) << "not before it is complete";

  const HttpResponse done = send("POST", path + "/complete");
  ASSERT_EQ(done.status, 201) << done.body;
  EXPECT_THAT(done.headers, Contains(Pair("Location", "/v1/maps/town/versions/v2")));
  EXPECT_EQ(body(done)["digest"], digest_);
  EXPECT_EQ(get("/v1/maps/town/versions/v2").status, 200);
  EXPECT_EQ(body(get(path))["status"], "complete");
  EXPECT_FALSE(has_bytes(path)) << "they are in the package";
  const HttpResponse again = send("POST", path + "/complete");
  EXPECT_EQ(again.status, 200);
  EXPECT_EQ(body(again)["digest"], digest_);
  EXPECT_EQ(body(get(kUploads))["uploads"].size(), 1U);
  EXPECT_EQ(send("DELETE", path).status, 204);
  EXPECT_TRUE(body(get(kUploads))["uploads"].empty());
  EXPECT_EQ(get("/v1/maps/town/versions/v2").status, 200);
}

TEST_F(Uploads, SameVersionAgainIsTheSameAndAnotherIsRefused) {
  start();
  EXPECT_EQ(send("POST", filled("v2", tar_) + "/complete").status, 201);
  EXPECT_EQ(send("POST", filled("v2", tar_) + "/complete").status, 200);
  const std::string other = filled("v1", tar_);
  const HttpResponse refused = send("POST", other + "/complete");
  EXPECT_EQ(refused.status, 409);
  EXPECT_EQ(body(refused)["code"], "OtherDigest");
  EXPECT_EQ(body(get(other))["status"], "open") << "to be removed by whoever sent it";
  EXPECT_EQ(send("DELETE", other).status, 204);
  EXPECT_FALSE(has_bytes(other));
}

TEST_F(Uploads, WhatIsNoPackageFailsInWordsAndTakesNoRoom) {
  start();
  const std::string path = filled("v2", std::string(20'000, 'x'));
  const HttpResponse refused = send("POST", path + "/complete");
  EXPECT_EQ(refused.status, 422);
  EXPECT_EQ(body(refused)["code"], "InvalidUpload");
  const json failed = body(get(path));
  EXPECT_EQ(failed["status"], "failed");
  EXPECT_FALSE(failed["error"].get<std::string>().empty());
  EXPECT_FALSE(has_bytes(path));
  for (const std::string& text : {refused.body, failed.dump()})
    EXPECT_THAT(text, Not(HasSubstr(store_.folder().path().string())));
  EXPECT_EQ(body(put(path + "/parts/3", "x"))["code"], "DriveNotOpen");
  EXPECT_EQ(body(send("POST", path + "/complete"))["code"], "DriveNotOpen");
  // A damaged file in a package that is else right.
  std::string damaged = tar_;
  damaged[damaged.find("frame_id") + 2] ^= 1;
  EXPECT_EQ(send("POST", filled("v2", damaged) + "/complete").status, 422);
  EXPECT_EQ(get("/v1/maps/town/versions/v2").status, 404);
}

TEST_F(Uploads, CloudFromElsewhereIsConverted) {
  start_with("publish");
  const std::string path = filled("v2", pcd("cloud"), "application/vnd.pcd");
  const HttpResponse accepted = send("POST", path + "/complete");
  ASSERT_EQ(accepted.status, 202) << accepted.body;
  EXPECT_EQ(body(accepted)["kind"], "convert");
  const std::string job = "/v1/jobs/" + std::to_string(body(accepted)["id"].get<int>());
  EXPECT_EQ(wait_for_end(job)["status"], "succeeded");
  const HttpResponse again = send("POST", path + "/complete");
  EXPECT_EQ(again.status, 200);
  EXPECT_EQ(body(again)["version"], "v2");
  EXPECT_FALSE(has_bytes(path));
}

TEST_F(Uploads, WhatIsNoCloudFailsAtOnce) {
  start_with("publish");
  const std::string path = filled("v2", "no cloud at all", "application/vnd.pcd");
  EXPECT_EQ(send("POST", path + "/complete").status, 422);
  EXPECT_EQ(body(get(path))["status"], "failed");
  EXPECT_FALSE(has_bytes(path));
}

TEST_F(Uploads, AskedAgainWhileItIsConvertedTheJobIsTold) {
  start_with("exit 1");
  const std::string path = filled("v2", kPly, "application/ply");
  const HttpResponse accepted = send("POST", path + "/complete");
  ASSERT_EQ(accepted.status, 202);
  const json job = wait_for_end("/v1/jobs/" + std::to_string(body(accepted)["id"].get<int>()));
  EXPECT_EQ(job["status"], "failed");
  const HttpResponse again = send("POST", path + "/complete");
  EXPECT_EQ(again.status, 202);
  EXPECT_EQ(body(again)["id"], job["id"]);
  EXPECT_EQ(body(again)["status"], "failed");
}

TEST_F(Uploads, MapIsMadeWhenItIsNewAndGoesWithWhatWasCompleted) {
  start();
  const HttpResponse made = send("POST", "/v1/maps/yard/uploads",
                                 R"({"version": "v1", "content_type": "application/x-tar"})");
  ASSERT_EQ(made.status, 201);
  EXPECT_EQ(get("/v1/maps/yard").status, 200);
  EXPECT_EQ(body(send("DELETE", "/v1/maps/yard"))["code"], "InUse") << "it is under way";
  const std::string path = "/v1/maps/yard/uploads/" + std::to_string(body(made)["id"].get<int>());
  EXPECT_EQ(put(path + "/parts/1", tar_).status, 201);
  EXPECT_EQ(send("POST", path + "/complete").status, 201);
  EXPECT_EQ(send("DELETE", "/v1/maps/yard").status, 204);
  EXPECT_EQ(get(path).status, 404);
}

TEST_F(Uploads, AreNoDrivesAndBelongToTheirMap) {
  start_with("publish");
  store_.open().create_map("village");
  const std::string upload = filled("v2", tar_);
  const std::string id = upload.substr(upload.rfind('/') + 1);
  EXPECT_EQ(body(get("/v1/maps/town/drives"))["drives"].size(), 1U);
  EXPECT_EQ(body(get("/v1/maps/town/drives/" + id))["code"], "UnknownDrive");
  EXPECT_EQ(send("POST", "/v1/maps/town/drives/" + id + "/complete").status, 404);
  EXPECT_EQ(body(send("POST", "/v1/maps/town/rebuild", "{\"drives\": [" + id + "]}"))["code"],
            "UnknownDrive");
  EXPECT_EQ(body(get(std::string(kUploads) + "/1"))["code"], "UnknownUpload") << "a drive";
  for (const std::string& path :
       {"/v1/maps/village/uploads/" + id, std::string(kUploads) + "/0" + id,
        std::string(kUploads) + "/99999999999999999999", std::string(kUploads) + "/-1"}) {
    EXPECT_EQ(body(get(path))["code"], "UnknownUpload") << path;
    EXPECT_EQ(put(path + "/parts/1", "x").status, 404) << path;
    EXPECT_EQ(send("POST", path + "/complete").status, 404) << path;
    EXPECT_EQ(send("DELETE", path).status, 404) << path;
  }
  EXPECT_EQ(body(get("/v1/maps/hamlet/uploads"))["code"], "UnknownMap");
}

TEST_F(Uploads, BadRequestsAreRefusedByField) {
  start();
  const auto refused = [&](const std::string& text) { return body(send("POST", kUploads, text)); };
  EXPECT_EQ(refused("{}")["errors"][0]["path"], "version");
  EXPECT_EQ(refused("")["code"], "InvalidRequest");
  EXPECT_EQ(
      refused(R"({"version": "../x", "content_type": "application/x-tar"})")["errors"][0]["path"],
      "version");
  EXPECT_EQ(refused(R"({"version": "v2"})")["errors"][0]["path"], "content_type");
  EXPECT_EQ(refused(R"({"version": "v2", "content_type": "text/html"})")["code"],
            "UnsupportedMediaType");
  EXPECT_EQ(refused(R"({"version": "v2", "content_type": "application/ply", "x": 1})")["code"],
            "UnknownParameter");
  EXPECT_EQ(body(send("POST", "/v1/maps/.x/uploads",
                      R"({"version": "v2", "content_type": "application/ply"})"))["status"],
            400);
  const std::string path = path_of(opened("v2"));
  for (const char* part : {"0", "10001", "x", "-1", "1x"})
    EXPECT_EQ(put(path + "/parts/" + part, "x").status, 400) << part;
}

/// A body of so many bytes, none of which comes.
class AnnouncedBody final : public BodyStream {
 public:
  explicit AnnouncedBody(std::uint64_t bytes) : bytes_(bytes) {}
  [[nodiscard]] std::uint64_t size() const override { return bytes_; }
  std::size_t read(std::span<char>) override {
    was_read_ = true;
    return 0;
  }
  [[nodiscard]] bool was_read() const { return was_read_; }

 private:
  std::uint64_t bytes_;
  bool was_read_ = false;
};

/// No fixed size: what is refused is what the disk has no room for.
TEST_F(Uploads, AreBoundedByTheDiskAlone) {
  EXPECT_EQ(options_.uploads.max_package_bytes, 0);
  EXPECT_EQ(options_.uploads.max_entries, 0);
  start();
  const std::string path = path_of(opened("v2"));
  for (const std::uint64_t bytes : {std::uint64_t{1} << 45U, std::uint64_t{1} << 62U}) {
    HttpRequest asked = request("PUT", path + "/parts/1");
    AnnouncedBody stream(bytes);
    asked.stream = &stream;
    const HttpResponse refused = service_->handle(asked);
    EXPECT_EQ(refused.status, 507) << bytes << refused.body;
    EXPECT_FALSE(stream.was_read()) << "refused before it comes";
  }
  EXPECT_EQ(put(path + "/parts/1", "x").status, 201);
}

TEST_F(Uploads, SizeOfAllPartsIsThatOfAPackage) {
  options_.uploads.max_package_bytes = 1 << 20;
  start();
  const std::string path = path_of(opened("v2"));
  EXPECT_EQ(put(path + "/parts/1", std::string(1 << 20, 'a')).status, 201);
  const HttpResponse more = put(path + "/parts/2", "b");
  EXPECT_EQ(more.status, 413);
  EXPECT_EQ(body(more)["errors"][0]["path"], "upload");
}

TEST_F(Uploads, OutliveTheServer) {
  start();
  const std::string path = filled("v2", tar_);
  service_.reset();
  start();
  EXPECT_EQ(body(get(path))["parts"].size(), 2U);
  EXPECT_EQ(send("POST", path + "/complete").status, 201);
}

TEST_F(Uploads, CountTowardsTheQuotaUntilTheyAreComplete) {
  start();
  const std::uint64_t before = store_.open().state().bytes_of_map("town");
  const std::string path = filled("v2", tar_);
  EXPECT_EQ(store_.open().state().bytes_of_map("town"), before + tar_.size());
  EXPECT_EQ(send("POST", path + "/complete").status, 201);
  EXPECT_EQ(store_.open().state().bytes_of_map("town"),
            before + store_.open().state().version("town", "v2").bytes);
}

}  // namespace uploads_test
}  // namespace stillmap::server
