// How many vehicles that send a scan each 0.1 s a server on two cores bears.
//
//   server_vehicles --program STILLMAP --map MAP --drive DRIVE [--scans compact] [--vehicles 4,6,8]
//   [--seconds 60] [--hz 10]
//
// Each vehicle has a session and a connection, and goes up and down the drive, which has .bin
// files. It sends its newest scan when the answer to the one before has come, as the clients do; a
// scan that became old meanwhile is not sent. Scans are thinned before: a vehicle does that on its
// own cores. All of it runs on the same cores, so the generator's share is part of what bounds
// them.
#include <fmt/format.h>

#include <stillmap/localization/thinning.hpp>
#include <stillmap/maps/drive.hpp>
#include "store/package_store.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "client.hpp"
#include "machine_use.hpp"
#include "server_process.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::bench {
namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;

struct Arguments {
  std::filesystem::path program;
  std::filesystem::path map;
  std::filesystem::path drive;
  std::string scans = "compact";
  std::vector<int> vehicles = {2, 4, 6, 8};
  double seconds = 60.0;
  double hz = 10.0;
};

struct Tally {
  std::atomic<int> due = 0, answered = 0, refused = 0, ok = 0;
  std::mutex mutex;
  std::vector<double> answer_ms;
};

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// With times of points where the drive has them: then the server deskews.
std::string body_of(const maps::PointCloud& cloud, const std::string& scans) {
  const bool has_times = cloud.time_offsets_s.size() == cloud.size();
  std::string body;
  if (scans == "raw") {
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Eigen::Vector3f& p = cloud.positions[i];
      const std::array<float, 5> point{p.x(), p.y(), p.z(), 0.0F,
                                       has_times ? cloud.time_offsets_s[i] : 0.0F};
      body.append(reinterpret_cast<const char*>(point.data()), sizeof(point));
    }
    return body;
  }
  localization::ScanView view{.xyz = cloud.positions.data(),
                              .xyz_stride_bytes = sizeof(Eigen::Vector3f),
                              .size = cloud.size()};
  if (has_times) {
    view.time_s = cloud.time_offsets_s.data();
    view.time_stride_bytes = sizeof(float);
  }
  const auto thin =
      localization::encode_thin_scan(view, scans == "exact" ? localization::ThinProfile::kExact
                                                            : localization::ThinProfile::kCompact);
  return {thin.begin(), thin.end()};
}

std::vector<std::string> read_bodies(const maps::Drive& drive, const std::string& scans) {
  std::vector<std::string> bodies;
  for (std::size_t i = 0; i < drive.size(); ++i)
    bodies.push_back(body_of(drive.read(i).cloud, scans));
  return bodies;
}

std::string open_session(int port, const Eigen::Isometry3d& T_map_lidar) {
  const Eigen::Vector3d t = T_map_lidar.translation();
  const Eigen::Quaterniond q(T_map_lidar.linear());
  nlohmann::json covariance = nlohmann::json::array();
  for (int i = 0; i < 36; ++i) covariance.push_back(i % 7 == 0 ? (i < 21 ? 0.25 : 0.01) : 0.0);
  const nlohmann::json request = {{"map", "map"},
                                  {"prior",
                                   {{"position", {t.x(), t.y(), t.z()}},
                                    {"quaternion", {q.x(), q.y(), q.z(), q.w()}},
                                    {"covariance", covariance}}}};
  Client client(port, "application/json");
  const Client::Answer answer = client.request("POST", "/v1/sessions", request.dump());
  if (answer.status != 201) throw std::runtime_error("no session: " + answer.body);
  return nlohmann::json::parse(answer.body).at("id");
}

class Vehicles {
 public:
  explicit Vehicles(const Arguments& arguments)
      : arguments_(arguments),
        drive_(maps::Drive::open(arguments.drive)),
        bodies_(read_bodies(drive_, arguments.scans)) {}

  void measure(const std::filesystem::path& store) const {
    double bytes = 0.0;
    for (const std::string& body : bodies_) bytes += static_cast<double>(body.size());
    fmt::print("{} scans of {:.1f} kB in the mean, {} Hz for {} s\n", bodies_.size(),
               1e-3 * bytes / static_cast<double>(bodies_.size()), arguments_.hz,
               arguments_.seconds);
    fmt::print(
        "vehicles  sent  answered  refused  ok  p50 ms  p99 ms  server CPU ms  cores  "
        "others\n");
    for (const int vehicles : arguments_.vehicles) run(store, vehicles);
  }

 private:
  void run(const std::filesystem::path& store, int vehicles) const {
    const ServerProcess server(arguments_.program, store, 2);
    Tally tally;
    const OthersUse others(server);
    const double cpu_s = server.cpu_s();
    const Clock::time_point begin = Clock::now();
    {
      std::vector<std::jthread> threads;
      for (int i = 0; i < vehicles; ++i)
        threads.emplace_back([&, i] { drive(server.port(), i, vehicles, begin, tally); });
    }
    const double used_s = server.cpu_s() - cpu_s;
    const double seconds = Seconds(Clock::now() - begin).count();
    fmt::print("{:8} {:5.1f}% {:8.1f}% {:8} {:5.1f}% {:6.1f} {:7.1f} {:13.1f} {:7.2f} {:6.1f}%\n",
               vehicles, 100.0 * (tally.answered + tally.refused) / tally.due,
               100.0 * tally.answered / tally.due, tally.refused.load(),
               100.0 * tally.ok / tally.answered, quantile(tally.answer_ms, 0.5),
               quantile(tally.answer_ms, 0.99), 1e3 * used_s / tally.answered, used_s / seconds,
               100.0 * others.share().value_or(0.0));
  }

  void drive(int port, int number, int vehicles, Clock::time_point begin, Tally& tally) const {
    const std::size_t first =
        bodies_.size() * static_cast<std::size_t>(number) / static_cast<std::size_t>(vehicles);
    std::string session = open_session(port, drive_.T_map_lidar(first));
    Client client(port, arguments_.scans == "raw" ? "application/octet-stream"
                                                  : "application/vnd.stillmap.scan");
    const double period_s = 1.0 / arguments_.hz;
    const double phase_s = period_s * number / vehicles;
    const auto steps = static_cast<std::size_t>(arguments_.seconds * arguments_.hz);
    tally.due += static_cast<int>(steps);
    std::size_t scan_before = first;
    for (std::size_t step = 0; step < steps; ++step) {
      const double due_s = phase_s + period_s * static_cast<double>(step);
      const double late_s = Seconds(Clock::now() - begin).count() - due_s;
      // Its answer would come when the next scan is there.
      if (late_s > period_s) continue;
      const auto due = begin + std::chrono::duration_cast<Clock::duration>(Seconds(due_s));
      std::this_thread::sleep_until(due);
      const std::size_t scan = (first + step) % bodies_.size();
      if (scan < scan_before) session = open_session(port, drive_.T_map_lidar(scan));
      scan_before = scan;
      const auto stamp_ns = static_cast<std::int64_t>(1e9 * due_s) + 1'700'000'000'000'000'000;
      const Client::Answer answer =
          client.request("POST",
                         fmt::format("/v1/sessions/{}/scans?stamp_ns={}{}", session, stamp_ns,
                                     arguments_.scans == "raw" ? "&layout=xyzit" : ""),
                         bodies_[scan]);
      if (answer.status != 200) {
        ++tally.refused;
        continue;
      }
      ++tally.answered;
      if (nlohmann::json::parse(answer.body).at("status") == "ok") ++tally.ok;
      const std::lock_guard lock(tally.mutex);
      tally.answer_ms.push_back(1e3 * Seconds(Clock::now() - due).count());
    }
  }

  const Arguments& arguments_;
  maps::Drive drive_;
  std::vector<std::string> bodies_;
};

int run(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Vehicles that a server on two cores bears");
  app.add_option("--program", arguments.program)->required();
  app.add_option("--map", arguments.map)->required();
  app.add_option("--drive", arguments.drive)->required();
  app.add_option("--scans", arguments.scans)->check(CLI::IsMember({"raw", "exact", "compact"}));
  app.add_option("--vehicles", arguments.vehicles)->delimiter(',');
  app.add_option("--seconds", arguments.seconds);
  app.add_option("--hz", arguments.hz);
  CLI11_PARSE(app, argc, argv);
  const test::TemporaryFolder folder;
  const std::filesystem::path store = folder.path() / "store";
  std::filesystem::create_directories(store);
  {
    server::PackageStore made(store);
    made.add("map", "v1", arguments.map);
    made.activate("map", "v1");
  }
  Vehicles(arguments).measure(store);
  return 0;
}

}  // namespace
}  // namespace stillmap::bench

int main(int argc, char** argv) {
  try {
    return stillmap::bench::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "server_vehicles: {}\n", error.what());
    return 1;
  }
}
