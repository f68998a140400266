// What a pose costs over HTTP, and what becomes of too many of them. Everything on the same cores:
// a server process, this generator, and the localizer in this process to compare with.
//
//   server_load --program STILLMAP --map MAP --drive DRIVE [--seconds 60] [--overload-only]
//   [--scans raw|exact|compact] [--strict]
//
// --scans sends scans whole or thinned (localization/thin_scan.md), of a drive of .bin files.
// 1. overhead: each scan is posed over HTTP and by the localizer here, in turn; the median of the
//    differences.
// 2. CPU: queries per CPU-second of a server with two workers against one with one, in turns.
// 3. overload: in turns the capacity (a closed loop that keeps every worker busy), then 1.5 times
//    that rate in an open loop: requests are due at fixed times, whatever became of those before.
// With --strict the figures are limits (server/performance.md): exit code 1 when one is
// missed. An overload that misses one is repeated once, whole. What depends on being given the
// cores (in time, goodput, health, and memory, since what waits is held) is judged by the turns in
// which others took at most a tenth of them (memory, which stays, by all or none); where these are
// fewer than half it is not judged, and the exit code is 77 when it was missed. Memory grows by the
// most of any turn over the most of the one that warms up: what it is at one instant swings.
#include <fmt/format.h>

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/scan_file.hpp>
#include "store/package_store.hpp"

#include <Eigen/Geometry>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <ctime>
#include <fstream>
#include <optional>
#include <span>
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

/// Of every request of the overload; queue and workers are passed in a third of it.
constexpr int kDeadlineMs = 500;
constexpr double kOverload = 1.5;
/// Turns of an overload, each with its own capacity, after one that warms up.
constexpr int kTurns = 4;
/// Share of the machine beyond which others make figures of time meaningless.
constexpr double kOthersMost = 0.1;
/// Turns without others that are enough to judge by.
constexpr std::size_t kLeastQuiet = kTurns / 2;
/// A test that says this was neither passed nor failed (CMake's SKIP_RETURN_CODE).
constexpr int kNotJudged = 77;
/// More than are ever in flight, so that one is free whenever a request is due.
constexpr int kSenders = 56;

struct Arguments {
  std::filesystem::path program;
  std::filesystem::path map;
  std::filesystem::path drive;
  /// Made of the map for this run.
  std::filesystem::path store{};
  double seconds = 60.0;
  bool overload_only = false;
  bool strict = false;
  std::string scans = "raw";
};

struct Query {
  std::string target;
  std::string body;
  Eigen::Isometry3d T_map_prior;
};

double seconds_since(Clock::time_point begin) { return Seconds(Clock::now() - begin).count(); }

/// CPU time of this thread [ms].
double thread_cpu_ms() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

localization::ScanView raw_view(const std::string& body) {
  const std::size_t stride = maps::raw_point_bytes(maps::ScanFormat::kBinXyzi);
  return {.xyz = body.data(), .xyz_stride_bytes = stride, .size = body.size() / stride};
}

/// Scans that the map was not made of, from half a metre and two degrees beside their poses.
std::vector<Query> read_queries(const std::filesystem::path& folder, const std::string& map,
                                const std::string& scans) {
  const maps::Drive drive = maps::Drive::open(folder);
  std::vector<Query> queries;
  for (std::size_t i = 1; i < drive.size(); i += 2) {
    Query query;
    query.T_map_prior = drive.T_map_lidar(i);
    query.T_map_prior.translation() += Eigen::Vector3d(0.4, -0.3, 0.0);
    query.T_map_prior.rotate(Eigen::AngleAxisd(0.035, Eigen::Vector3d::UnitZ()));
    const Eigen::Vector3d t = query.T_map_prior.translation();
    const Eigen::Quaterniond q(query.T_map_prior.linear());
    query.target = fmt::format("/v1/maps/{}/localize?prior_t={},{},{}&prior_q={},{},{},{}", map,
                               t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
    std::ifstream file(drive.contents().scan_files[i], std::ios::binary);
    query.body.assign(std::istreambuf_iterator<char>(file), {});
    if (scans != "raw") {
      const auto bytes = localization::encode_thin_scan(
          raw_view(query.body), scans == "exact" ? localization::ThinProfile::kExact
                                                 : localization::ThinProfile::kCompact);
      query.body.assign(bytes.begin(), bytes.end());
    }
    queries.push_back(std::move(query));
  }
  return queries;
}

class Load {
 public:
  Load(Arguments arguments, std::string map)
      : arguments_(std::move(arguments)),
        map_(std::move(map)),
        queries_(read_queries(arguments_.drive, map_, arguments_.scans)) {}

  void measure_overhead();
  void measure_workers();
  /// Again, once, when it missed a limit.
  void measure_overload();
  [[nodiscard]] bool is_raw() const { return arguments_.scans == "raw"; }
  [[nodiscard]] std::string content_type() const {
    return is_raw() ? "application/octet-stream" : "application/vnd.stillmap.scan";
  }
  /// @return the exit code that the limits ask for.
  [[nodiscard]] int verdict() const { return failures_ > 0 ? 1 : unjudged_ > 0 ? kNotJudged : 0; }

 private:
  struct Tally {
    std::atomic<int> sent = 0, good = 0, prompt = 0, late = 0, refused = 0, other = 0;
  };

  /// What one turn of an overload came to.
  struct Turn {
    Tally tally{};
    /// Queries per second before it.
    double capacity = 0.0;
    double seconds = 0.0;
    std::vector<double> health_ms{};
    /// The most while it was overloaded.
    double memory_mib = 0.0;
    std::optional<double> others{};

    [[nodiscard]] bool is_quiet() const { return others.value_or(0.0) <= kOthersMost; }
  };
  /// The first warms up and is not counted.
  using Overload = std::array<Turn, kTurns + 1>;

  /// Of some turns together.
  struct Sum {
    int sent = 0, good = 0, prompt = 0, late = 0, refused = 0, other = 0;
    double seconds = 0.0;
    /// What the capacity would have answered in that time.
    double possible = 0.0;
    std::vector<double> health_ms{};

    void add(const Turn& turn);
  };

  void limit(const std::string& what, double value, bool holds, const std::string& bound,
             bool judged = true) {
    const char* verdict = holds ? "" : judged ? "MISSED" : "missed, not judged";
    fmt::print("{:<62} {:>9.3f}   {} {}\n", what, value, bound, verdict);
    if (!holds) ++(judged ? failures_ : unjudged_);
  }
  void overload_turn(const ServerProcess& server, int workers, std::atomic<Turn*>& overloaded,
                     Turn& turn) const;
  void overload_once(Overload& overload) const;
  void judge(const Overload& overload);
  double closed_loop(int port, int connections, double seconds) const;
  void open_loop(int port, double rate, double seconds, Tally& tally) const;

  Arguments arguments_;
  std::string map_;
  std::vector<Query> queries_;
  int failures_ = 0;
  int unjudged_ = 0;
};

void Load::measure_overhead() {
  const ServerProcess server(arguments_.program, arguments_.store, 1);
  const auto package = maps::MapPackage::open(arguments_.map);
  const auto aligner = localization::make_aligner("default", *package);
  Client client(server.port(), content_type());
  std::vector<double> http_ms, local_ms, difference_ms, local_cpu_ms;
  double server_cpu_s = 0.0;
  constexpr int kRounds = 8;
  for (int round = 0; round < kRounds; ++round) {
    if (round == 1) server_cpu_s = server.cpu_s();
    for (const Query& query : queries_) {
      const localization::ScanView whole = raw_view(query.body);
      const localization::ThinScan sent =
          is_raw() ? localization::ThinScan{}
                   : localization::decode_thin_scan(std::as_bytes(std::span(query.body)), "").scan;
      const Clock::time_point local = Clock::now();
      const double cpu_ms = thread_cpu_ms();
      static_cast<void>(aligner->align_thin(is_raw() ? aligner->thin(whole) : sent,
                                            localization::Prior{query.T_map_prior, {}}));
      local_ms.push_back(1e3 * seconds_since(local));
      local_cpu_ms.push_back(thread_cpu_ms() - cpu_ms);
      const Clock::time_point http = Clock::now();
      const Client::Answer answer = client.request("POST", query.target, query.body);
      http_ms.push_back(1e3 * seconds_since(http));
      if (answer.status != 200) throw std::runtime_error("no pose: " + answer.body);
      // The first round warms both.
      if (round > 0) difference_ms.push_back(http_ms.back() - local_ms.back());
    }
  }
  fmt::print("{} scans of {:.2f} MB, medians: localizer {:.2f} ms, over HTTP {:.2f} ms\n",
             queries_.size(), 1e-6 * static_cast<double>(queries_.front().body.size()),
             quantile(local_ms, 0.5), quantile(http_ms, 0.5));
  const double each_ms =
      1e3 * (server.cpu_s() - server_cpu_s) / static_cast<double>((kRounds - 1) * queries_.size());
  fmt::print("CPU: localizer {:.2f} ms (median), server {:.2f} ms a query (mean)\n",
             quantile(local_cpu_ms, 0.5), each_ms);
  const double added = quantile(difference_ms, 0.5);
  limit("HTTP adds, p50 [ms]", added, added <= 3.0, "<= 3");
}

/// @return queries answered per second.
double Load::closed_loop(int port, int connections, double seconds) const {
  std::atomic<int> answered = 0;
  const Clock::time_point begin = Clock::now();
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < connections; ++i) {
      threads.emplace_back([&, i] {
        Client client(port, content_type());
        for (std::size_t next = static_cast<std::size_t>(i); seconds_since(begin) < seconds;
             ++next) {
          const Query& query = queries_[next % queries_.size()];
          if (client.request("POST", query.target, query.body).status == 200) ++answered;
        }
      });
    }
  }
  return answered / seconds_since(begin);
}

void Load::measure_workers() {
  double per_cpu_s[2] = {0.0, 0.0};
  double rate[2] = {0.0, 0.0};
  double cpu_s[2] = {0.0, 0.0};
  double answered[2] = {0.0, 0.0};
  const ServerProcess one(arguments_.program, arguments_.store, 1);
  const ServerProcess two(arguments_.program, arguments_.store, 2);
  constexpr int kPairs = 5;
  for (int turn = -1; turn < kPairs; ++turn) {
    for (const int i : {0, 1}) {
      const ServerProcess& server = i == 0 ? one : two;
      const double before = server.cpu_s();
      const Clock::time_point begin = Clock::now();
      const double here = closed_loop(server.port(), i + 1, 1.5);
      if (turn < 0) continue;
      cpu_s[i] += server.cpu_s() - before;
      answered[i] += here * seconds_since(begin);
      rate[i] += here / kPairs;
    }
  }
  for (const int i : {0, 1}) per_cpu_s[i] = answered[i] / cpu_s[i];
  fmt::print(
      "one worker: {:.1f} queries/s, {:.2f} CPU-ms each; two: {:.1f} queries/s, {:.2f} CPU-ms "
      "each; wall ratio {:.2f}\n",
      rate[0], 1e3 / per_cpu_s[0], rate[1], 1e3 / per_cpu_s[1], rate[1] / rate[0]);
  const double ratio = per_cpu_s[1] / per_cpu_s[0];
  limit("queries per CPU-second, two workers to one", ratio, ratio >= 0.95, ">= 0.95");
}

void Load::open_loop(int port, double rate, double seconds, Tally& tally) const {
  const auto total = static_cast<int>(rate * seconds);
  const std::string deadline = fmt::format("&deadline_ms={}", kDeadlineMs);
  std::atomic<int> next = 0;
  const Clock::time_point begin = Clock::now();
  std::vector<std::jthread> threads;
  for (int i = 0; i < kSenders; ++i) {
    threads.emplace_back([&] {
      Client client(port, content_type());
      for (int mine = next++; mine < total; mine = next++) {
        const auto due = begin + std::chrono::duration_cast<Clock::duration>(Seconds(mine / rate));
        std::this_thread::sleep_until(due);
        const Query& query = queries_[static_cast<std::size_t>(mine) % queries_.size()];
        const int status = client.request("POST", query.target + deadline, query.body).status;
        ++tally.sent;
        // The server counts from the whole request, so a 200 is in time; a client that shares its
        // cores also waits for the way there and back.
        if (status == 200) {
          ++tally.good;
          if (1e3 * seconds_since(due) <= kDeadlineMs) ++tally.prompt;
        } else if (status == 504) {
          ++tally.late;
        } else if (status == 429 || status == 503) {
          ++tally.refused;
        } else {
          ++tally.other;
        }
      }
    });
  }
}

void Load::overload_turn(const ServerProcess& server, int workers, std::atomic<Turn*>& overloaded,
                         Turn& turn) const {
  const OthersUse others(server);
  const double turn_s = arguments_.seconds / (kTurns + 1);
  turn.capacity = closed_loop(server.port(), 2 * workers, 0.25 * turn_s);
  turn.seconds = 0.75 * turn_s;
  overloaded = &turn;
  open_loop(server.port(), kOverload * turn.capacity, turn.seconds, turn.tally);
  overloaded = nullptr;
  turn.others = others.share();
}

void Load::overload_once(Overload& overload) const {
  const int workers = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  const ServerProcess server(arguments_.program, arguments_.store, workers);
  std::atomic<bool> done = false;
  std::atomic<Turn*> overloaded = nullptr;
  std::jthread health([&] {
    Client client(server.port());
    while (!done) {
      const Clock::time_point begin = Clock::now();
      Turn* const turn = overloaded;
      const bool alive = client.request("GET", "/livez").status == 200;
      if (turn != nullptr) {
        turn->health_ms.push_back(alive ? 1e3 * seconds_since(begin) : 1e4);
        turn->memory_mib = std::max(turn->memory_mib, server.memory_mib());
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  for (Turn& turn : overload) overload_turn(server, workers, overloaded, turn);
  done = true;
  health.join();
}

void Load::Sum::add(const Turn& turn) {
  sent += turn.tally.sent;
  good += turn.tally.good;
  prompt += turn.tally.prompt;
  late += turn.tally.late;
  refused += turn.tally.refused;
  other += turn.tally.other;
  seconds += turn.seconds;
  possible += turn.capacity * turn.seconds;
  health_ms.insert(health_ms.end(), turn.health_ms.begin(), turn.health_ms.end());
}

void Load::judge(const Overload& overload) {
  Sum all, quiet;
  std::size_t quiet_turns = 0;
  double most_mib = 0.0;
  for (std::size_t i = 1; i < overload.size(); ++i) {
    const Turn& turn = overload[i];
    fmt::print("turn {}: capacity {:.1f}/s, {} in time of {} sent; others took {}\n", i,
               turn.capacity, turn.tally.good.load(), turn.tally.sent.load(),
               turn.others ? fmt::format("{:.1f} % of the cores", 100.0 * *turn.others)
                           : "what cannot be told here");
    all.add(turn);
    if (turn.is_quiet()) quiet.add(turn);
    quiet_turns += turn.is_quiet() ? 1 : 0;
    most_mib = std::max(most_mib, turn.memory_mib);
  }
  const bool is_judged = quiet_turns >= kLeastQuiet;
  const Sum& sum = is_judged ? quiet : all;
  const double warm_mib = overload.front().memory_mib;
  fmt::print(
      "overload, {} turns: capacity {:.1f}/s; sent {:.1f}/s: {} in time ({} from when they were "
      "due), {} late, {} refused, {} other; memory {:.0f} -> {:.0f} MiB\n",
      is_judged ? quiet_turns : kTurns, sum.possible / sum.seconds, sum.sent / sum.seconds,
      sum.good, sum.prompt, sum.late, sum.refused, sum.other, warm_mib, most_mib);
  const double served = static_cast<double>(sum.good) / std::max(1, sum.sent - sum.refused);
  limit("admitted that are 200 within their deadline", served, served >= 0.99, ">= 0.99",
        is_judged);
  limit("answers other than 200, 429, 503, 504", all.other, all.other == 0, "== 0");
  const double goodput = sum.prompt / sum.possible;
  limit("goodput to capacity", goodput, goodput >= 0.8, ">= 0.8", is_judged);
  const double health_p99 = quantile(sum.health_ms, 0.99);
  limit("health p99 [ms]", health_p99, health_p99 < 50.0, "< 50", is_judged);
  const double grown = most_mib - warm_mib;
  limit("memory growth [MiB]", grown, grown < 20.0, "< 20", quiet_turns == kTurns);
}

void Load::measure_overload() {
  const int failures = failures_;
  for (int attempt = 0; attempt < 2; ++attempt) {
    failures_ = failures;
    unjudged_ = 0;
    Overload overload;
    overload_once(overload);
    judge(overload);
    if (failures_ == failures && unjudged_ == 0) return;
    if (attempt == 0) fmt::print("once more, since what was missed may have been the machine's\n");
  }
}

constexpr const char* kMapName = "load";

void make_store(const std::filesystem::path& folder, const std::filesystem::path& package) {
  std::filesystem::create_directory(folder);
  server::PackageStore store(folder);
  store.add(kMapName, "v1", package);
  store.activate(kMapName, "v1");
}

int run(int argc, char** argv) {
  Arguments arguments;
  CLI::App app("Load of a stillmap server");
  app.add_option("--program", arguments.program, "The program stillmap")->required();
  app.add_option("--map", arguments.map, "The map package")->required();
  app.add_option("--drive", arguments.drive, "Drive whose odd scans are not in the map")
      ->required();
  app.add_option("--seconds", arguments.seconds, "Of the overload")->capture_default_str();
  app.add_flag("--overload-only", arguments.overload_only, "Neither overhead nor workers");
  app.add_option("--scans", arguments.scans, "How scans are sent")
      ->check(CLI::IsMember({"raw", "exact", "compact"}))
      ->capture_default_str();
  app.add_flag("--strict", arguments.strict, "A figure beyond its limit is a failure");
  CLI11_PARSE(app, argc, argv);
  const test::TemporaryFolder folder;
  arguments.store = folder.path() / "store";
  make_store(arguments.store, arguments.map);
  Load load(arguments, kMapName);
  if (!arguments.overload_only) {
    load.measure_overhead();
    load.measure_workers();
  }
  load.measure_overload();
  return arguments.strict ? load.verdict() : 0;
}

}  // namespace
}  // namespace stillmap::bench

int main(int argc, char** argv) {
  try {
    return stillmap::bench::run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "server_load: {}\n", error.what());
    return 1;
  }
}
