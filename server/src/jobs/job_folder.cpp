#include "jobs/job_folder.hpp"

#include "jobs/child_process.hpp"
#include "store/ids_and_times.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>
#include "store/disk_full.hpp"

#include <array>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string_view>
#include <system_error>

namespace stillmap::server {
namespace fs = std::filesystem;

namespace {

[[noreturn]] void fail(const fs::path& file) {
  if (errno == ENOSPC || errno == EDQUOT)
    throw DiskFull(file.string(), std::string("cannot be written: ") + std::strerror(errno));
  throw maps::StorageError(file.string(),
                           std::string("cannot be written: ") + std::strerror(errno));
}

void write_synced(const fs::path& file, std::string_view text) {
  const Descriptor opened(
      ::open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0666));
  if (!opened.is_open()) fail(file);
  while (!text.empty()) {
    const ssize_t written = ::write(opened.get(), text.data(), text.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) fail(file);
    text.remove_prefix(static_cast<std::size_t>(written));
  }
  if (::fsync(opened.get()) != 0) fail(file);
}

constexpr const char* kServerName = ".server";

/// That nobody else has. It begins with the host's, for people.
std::string new_server_name() {
  std::array<char, 64> host{};
  std::string name = ::gethostname(host.data(), host.size() - 1) == 0 ? host.data() : "";
  std::erase_if(name, [](unsigned char byte) { return std::isalnum(byte) == 0 && byte != '-'; });
  constexpr std::size_t kDigits = 8;
  return (name.empty() ? "server" : name) + "-" + random_hex(kDigits);
}

}  // namespace

std::string server_of(const fs::path& folder) {
  return read_small_file(folder / kServerName).value_or("");
}

std::string name_server_of(const fs::path& folder) {
  if (std::string known = server_of(folder); !known.empty()) return known;
  fs::create_directories(folder);
  const std::string name = new_server_name();
  const fs::path own = folder / (kServerName + ("-" + name));
  write_synced(own, name);
  // Servers may share the folder: the first one names it.
  const bool is_named = ::link(own.c_str(), (folder / kServerName).c_str()) == 0 || errno == EEXIST;
  std::error_code error;
  if (!is_named) fail(folder / kServerName);
  fs::remove(own, error);
  sync_folder(folder);
  return server_of(folder);
}

void write_small_file(const fs::path& file, const std::string& text) {
  const fs::path half = file.string() + ".new";
  write_synced(half, text);
  if (std::rename(half.c_str(), file.c_str()) != 0) fail(file);
  sync_folder(file.parent_path());
}

void sync_folder(const fs::path& folder) {
  const Descriptor opened(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!opened.is_open() || ::fsync(opened.get()) != 0)
    throw maps::StorageError(folder.string(), "cannot be synced");
}

std::optional<std::string> read_small_file(const fs::path& file) {
  constexpr std::uintmax_t kMost = std::uintmax_t{1} << 20U;
  std::error_code error;
  const std::uintmax_t size = fs::file_size(file, error);
  if (error || size > kMost) return std::nullopt;
  std::ifstream stream(file, std::ios::binary);
  if (!stream) return std::nullopt;
  return std::string(std::istreambuf_iterator<char>(stream), {});
}

void clear_folder(const fs::path& folder) {
  std::error_code error;
  fs::remove_all(folder, error);
}

}  // namespace stillmap::server
