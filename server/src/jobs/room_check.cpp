#include "jobs/room_check.hpp"

#include "errors/api_error.hpp"
#include "errors/exit_codes.hpp"
#include "jobs/job_attempt.hpp"
#include "store/free_bytes.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <nlohmann/json.hpp>

#include <cstdint>
#include <filesystem>
#include <optional>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// What `stillmap rebuild --estimate` says [bytes].
struct Estimate {
  std::uint64_t package = 0;
  std::uint64_t work = 0;
};

std::optional<Estimate> read_estimate(const std::string& text) {
  // Warnings may stand before it.
  const std::size_t begin = text.find("{\n");
  if (begin == std::string::npos) return std::nullopt;
  const auto json = nlohmann::json::parse(text.substr(begin), nullptr, false);
  if (!json.is_object() || !json.contains("package_bytes") || !json.contains("work_bytes") ||
      !json["package_bytes"].is_number_unsigned() || !json["work_bytes"].is_number_unsigned())
    return std::nullopt;
  return Estimate{.package = json["package_bytes"], .work = json["work_bytes"]};
}

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  const std::size_t begin = text.find_last_of('\n');
  return begin == std::string::npos ? text : text.substr(begin + 1);
}

bool on_one_disk(const fs::path& a, const fs::path& b) {
  struct stat first {};
  struct stat second {};
  return ::stat(a.c_str(), &first) == 0 && ::stat(b.c_str(), &second) == 0 &&
         first.st_dev == second.st_dev;
}

}  // namespace

void RoomCheck::require(const fs::path& folder, std::uint64_t bytes) const {
  const std::uint64_t room = free_bytes(folder);
  if (bytes <= room) return setup_.store.check_disk_reserve(folder, bytes);
  throw ApiError(ErrorCode::kDiskFull,
                 fmt::format("it needs about {} bytes, and {} are free", bytes, room));
}

void RoomCheck::check(const std::string& map, const RebuildRequest& request,
                      const RebuildSources& sources, std::chrono::seconds most,
                      const std::function<bool()>& is_unwanted) const {
  if (setup_.mapper.empty())
    throw ApiError(ErrorCode::kNoMapper, "stillmap-mapper is not installed beside the server");
  const ProgramOutput output = run_short(estimate_command(setup_.mapper, request, sources),
                                         setup_.limits(), most, is_unwanted);
  const std::optional<Estimate> estimate = read_estimate(output.text);
  if (output.timed_out || output.end.exit_code != exit_code::kSucceeded || !estimate) {
    const std::string said = folders_.without_places(last_line(output.text));
    if (output.end.exit_code == exit_code::kFailed || output.end.exit_code == exit_code::kUsage)
      throw ApiError(ErrorCode::kInvalidRequest, said);
    throw ProgramCrash("no estimate of the disk: " + output.end.words() +
                       (said.empty() ? "" : ": " + said));
  }
  setup_.store.check_quota(map, estimate->package);
  // The map is copied into the store before the job's folder is cleared.
  const bool shared = on_one_disk(folders_.root(), setup_.store.folder());
  require(folders_.root(), estimate->work + estimate->package * (shared ? 2 : 1));
  if (!shared) require(setup_.store.folder(), estimate->package);
}

}  // namespace stillmap::server
