// Streams a drive in KITTI layout (DRIVE/velodyne/*.bin) through a session, at the rate of its
// sensor: a server that is slower gets the newest scan, not the oldest.
//
//   stream_drive http://127.0.0.1:8080 MAP DRIVE [SCANS_PER_SECOND]
//
// A key is taken from the environment variable STILLMAP_KEY.

#include "stillmap_client.hpp"

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace {

namespace client = stillmap::client;

std::vector<std::filesystem::path> scans_of(const std::filesystem::path& drive) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(drive / "velodyne"))
    if (entry.path().extension() == ".bin") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<float> read_scan(const std::filesystem::path& file) {
  std::vector<float> xyzi(std::filesystem::file_size(file) / sizeof(float));
  std::ifstream(file, std::ios::binary)
      .read(reinterpret_cast<char*>(xyzi.data()),
            static_cast<std::streamsize>(xyzi.size() * sizeof(float)));
  return xyzi;
}

void print(std::int64_t stamp_ns, const client::PoseAnswer& answer) {
  const auto position = answer.pose ? answer.pose->position : std::array<double, 3>{};
  std::printf("%.3f %s %.3f %.3f %.3f\n", 1e-9 * static_cast<double>(stamp_ns),
              answer.status.c_str(), position[0], position[1], position[2]);
}

int stream(const char* url, const char* map, const char* drive, double scans_per_second) {
  const char* const key = std::getenv("STILLMAP_KEY");
  client::SessionStream session(client::Client(url, key == nullptr ? "" : key), map, print,
                                [](std::int64_t stamp_ns, const client::Error& error) {
                                  std::fprintf(stderr, "%.3f %s\n",
                                               1e-9 * static_cast<double>(stamp_ns), error.what());
                                });
  const std::chrono::duration<double> period(1.0 / scans_per_second);
  const auto begin = std::chrono::steady_clock::now();
  std::chrono::duration<double> at(0.0);
  for (const std::filesystem::path& file : scans_of(drive)) {
    std::this_thread::sleep_until(
        begin + std::chrono::duration_cast<std::chrono::steady_clock::duration>(at));
    session.put(
        {std::chrono::duration_cast<std::chrono::nanoseconds>(at).count(), read_scan(file)});
    at += period;
  }
  const bool done = session.drain(std::chrono::seconds(60));
  const client::SessionStream::Counts counts = session.counts();
  std::printf("%ju answered, %ju replaced by newer ones, %ju failed, %ju sessions\n",
              std::uintmax_t{counts.answered}, std::uintmax_t{counts.superseded},
              std::uintmax_t{counts.failed}, std::uintmax_t{counts.sessions});
  return done && counts.answered > 0 ? 0 : 1;
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 4 || count > 5) {
    std::fprintf(stderr, "usage: %s URL MAP DRIVE [SCANS_PER_SECOND]\n", arguments[0]);
    return 2;
  }
  const double rate = count == 5 ? std::atof(arguments[4]) : 10.0;
  if (!(rate > 0.0)) {
    std::fprintf(stderr, "SCANS_PER_SECOND: found '%s', expected a number above 0\n", arguments[4]);
    return 2;
  }
  try {
    return stream(arguments[1], arguments[2], arguments[3], rate);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
