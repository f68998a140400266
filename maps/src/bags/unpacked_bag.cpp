#include "bags/unpacked_bag.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "bags/byte_stream.hpp"
#include "formats/file_reader.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

/// Points are packed to half or a third of their bytes, text to a tenth.
constexpr std::uint64_t kMostRatio = 100;
constexpr std::uint64_t kAlwaysTakenBytes = std::uint64_t{16} << 20U;
constexpr std::size_t kCopiedBytes = std::size_t{1} << 20U;

[[noreturn]] void refuse(const fs::path& packed, const std::string& what, int code) {
  throw StorageError(packed.string(), fmt::format("{}: {}; unpack it where there is room (zstd -d)",
                                                  what, std::strerror(code)));
}

/// A file without a name. @return -1 where the folder takes none.
int nameless_file(const fs::path& folder) {
  return ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
}

void write_all(int descriptor, std::span<const std::byte> bytes, const fs::path& packed,
               std::uint64_t before) {
  while (!bytes.empty()) {
    const ssize_t done = ::write(descriptor, bytes.data(), bytes.size());
    if (done < 0 && errno == EINTR) continue;
    const int code = errno;
    if (done < 0)
      refuse(packed, fmt::format("no room for more than {} unpacked bytes", before), code);
    bytes = bytes.subspan(static_cast<std::size_t>(done));
  }
}

}  // namespace

bool is_packed_bag(const fs::path& file) {
  const std::string outer = file.extension().string();
  const std::string inner = file.stem().extension().string();
  if ((outer != ".zstd" && outer != ".zst") || (inner != ".mcap" && inner != ".db3")) return false;
  std::error_code error;
  if (!fs::is_regular_file(file, error)) return false;
  constexpr std::array<unsigned char, 4> kMagic{0x28, 0xB5, 0x2F, 0xFD};
  std::array<std::byte, kMagic.size()> head{};
  return FileReader(file).read_at(0, head) == head.size() &&
         std::memcmp(head.data(), kMagic.data(), head.size()) == 0;
}

UnpackedBag::UnpackedBag(const fs::path& packed) {
  fs::path folder = fs::absolute(packed).parent_path();
  descriptor_ = nameless_file(folder);
  if (descriptor_ < 0) {
    folder = fs::temp_directory_path();
    descriptor_ = nameless_file(folder);
  }
  if (descriptor_ < 0) refuse(packed, "no place to unpack it to", errno);
  try {
    unpack(packed);
    give_name(folder);
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

UnpackedBag::~UnpackedBag() {
  ::unlink(file_.c_str());
  ::close(descriptor_);
}

void UnpackedBag::unpack(const fs::path& packed) {
  const FileReader reader(packed);
  const std::uint64_t most = kAlwaysTakenBytes + kMostRatio * reader.size();
  const auto stream =
      unpacked(std::make_unique<FileStream>(reader, 0, reader.size()), "zstd", packed.string());
  std::vector<std::byte> piece(kCopiedBytes);
  while (const std::size_t got = stream->read(piece)) {
    if (size_ + got > most)
      throw InputError(
          packed.string(), fmt::format("more than {} unpacked bytes", most),
          fmt::format("at most {} times the packed ones: unpack the file first", kMostRatio));
    write_all(descriptor_, std::span(piece).first(got), packed, size_);
    size_ += got;
  }
}

/// SQLite opens files by names alone, and follows /proc/self/fd to the name that there is none of.
void UnpackedBag::give_name(const fs::path& folder) {
  const std::string self = fmt::format("/proc/self/fd/{}", descriptor_);
  for (int attempt = 0; attempt < 100; ++attempt) {
    file_ = folder / fmt::format(".stillmap_unpacked_{}_{}_{}", ::getpid(), descriptor_, attempt);
    if (::linkat(AT_FDCWD, self.c_str(), AT_FDCWD, file_.c_str(), AT_SYMLINK_FOLLOW) == 0) return;
    if (errno != EEXIST) break;
  }
  throw StorageError(file_.string(), std::strerror(errno));
}

}  // namespace stillmap::maps
