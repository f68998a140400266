#include <stillmap/maps/error.hpp>
#include <stillmap/maps/point_fates.hpp>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

namespace stillmap::maps {
namespace {

/// Layout, little endian: magic; for each scan its number of points and then its runs, all as
/// variable length integers of 7 bits a byte: length << 3 | fate, and for moved points the object;
/// offsets of the scans and of the end of the last one (u64 each); number of scans (u64).
constexpr std::string_view kFatesMagic = "smfates1";
/// No sensor gives more in one scan; a broken file must not make us reserve more.
constexpr std::uint64_t kMostPoints = 1U << 26U;

void put_varint(std::string& bytes, std::uint64_t value) {
  for (; value >= 0x80U; value >>= 7U) bytes += static_cast<char>(0x80U | (value & 0x7FU));
  bytes += static_cast<char>(value);
}

bool has_object(PointFate fate) {
  return fate == PointFate::kProjected || fate == PointFate::kDeleted;
}

std::string runs_of(const ScanFates& scan) {
  std::string bytes;
  put_varint(bytes, scan.size());
  for (std::size_t i = 0; i < scan.size();) {
    std::size_t end = i + 1;
    while (end < scan.size() && scan.fates[end] == scan.fates[i] &&
           (scan.objects[end] == scan.objects[i] || !has_object(scan.fates[i])))
      ++end;
    put_varint(bytes, (end - i) << 3U | static_cast<std::uint64_t>(scan.fates[i]));
    if (has_object(scan.fates[i])) put_varint(bytes, scan.objects[i]);
    i = end;
  }
  return bytes;
}

/// Reads integers off a string, refusing to run over its end.
class Runs {
 public:
  Runs(std::string bytes, std::string file) : bytes_(std::move(bytes)), file_(std::move(file)) {}

  std::uint64_t next(std::uint64_t most) {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 63; shift += 7) {
      if (at_ == bytes_.size()) refuse("a number that ends early");
      const auto byte = static_cast<std::uint8_t>(bytes_[at_++]);
      value |= static_cast<std::uint64_t>(byte & 0x7FU) << shift;
      if ((byte & 0x80U) != 0) continue;
      if (value > most) refuse(std::to_string(value));
      return value;
    }
    refuse("a number of more than 9 bytes");
  }
  [[nodiscard]] bool at_end() const { return at_ == bytes_.size(); }
  [[noreturn]] void refuse(const std::string& found) const {
    throw InputError(file_, found, "fates of points as stillmap writes them");
  }

 private:
  std::string bytes_;
  std::string file_;
  std::size_t at_ = 0;
};

ScanFates parse(Runs runs) {
  ScanFates scan;
  const std::uint64_t points = runs.next(kMostPoints);
  scan.fates.reserve(points);
  scan.objects.reserve(points);
  while (scan.size() < points) {
    const std::uint64_t run = runs.next((points - scan.size()) << 3U | 7U);
    const std::uint64_t length = run >> 3U;
    if (length == 0 || (run & 7U) >= kPointFates) runs.refuse("run " + std::to_string(run));
    const auto fate = static_cast<PointFate>(run & 7U);
    const std::uint64_t object =
        has_object(fate) ? runs.next(std::numeric_limits<std::uint32_t>::max()) : 0;
    scan.fates.insert(scan.fates.end(), length, fate);
    scan.objects.insert(scan.objects.end(), length, static_cast<std::uint32_t>(object));
  }
  if (!runs.at_end()) runs.refuse("bytes after the last run");
  return scan;
}

std::string read_at(std::ifstream& in, std::uint64_t offset, std::uint64_t bytes,
                    const std::string& file) {
  std::string text(bytes, '\0');
  in.seekg(static_cast<std::streamoff>(offset));
  if (!in.read(text.data(), static_cast<std::streamsize>(bytes)))
    throw StorageError(file, "cannot be read at byte " + std::to_string(offset));
  return text;
}

std::uint64_t number_at(std::ifstream& in, std::uint64_t offset, const std::string& file) {
  std::uint64_t value = 0;
  std::memcpy(&value, read_at(in, offset, sizeof(value), file).data(), sizeof(value));
  return value;
}

}  // namespace

FatesWriter::FatesWriter(std::filesystem::path file)
    : file_(std::move(file)), stream_(std::fopen(file_.c_str(), "wb")) {
  if (!stream_) throw StorageError(file_.string(), std::strerror(errno));
  write(kFatesMagic.data(), kFatesMagic.size());
}

void FatesWriter::write(const void* bytes, std::size_t count) {
  if (std::fwrite(bytes, 1, count, stream_.get()) != count)
    throw StorageError(file_.string(), std::strerror(errno));
  position_ += count;
}

void FatesWriter::add(const ScanFates& fates) {
  if (fates.fates.size() != fates.objects.size())
    throw std::invalid_argument("fates: not one object for each");
  begins_.push_back(position_);
  const std::string bytes = runs_of(fates);
  write(bytes.data(), bytes.size());
}

void FatesWriter::finish() {
  const std::uint64_t scans = begins_.size();
  begins_.push_back(position_);
  write(begins_.data(), begins_.size() * sizeof(std::uint64_t));
  write(&scans, sizeof(scans));
  // A full disk may show only when the buffer goes out.
  if (std::fclose(stream_.release()) != 0) throw StorageError(file_.string(), std::strerror(errno));
}

ScanFates read_fates(const std::filesystem::path& file, std::size_t scan) {
  const std::string name = file.string();
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in) throw StorageError(name, std::strerror(errno));
  const auto size = static_cast<std::uint64_t>(in.tellg());
  constexpr std::uint64_t kNumber = sizeof(std::uint64_t);
  if (size < kFatesMagic.size() + 2 * kNumber ||
      read_at(in, 0, kFatesMagic.size(), name) != kFatesMagic)
    throw InputError(name, "another file", "fates of points as stillmap writes them");
  const std::uint64_t scans = number_at(in, size - kNumber, name);
  if (scans >= (size - kFatesMagic.size()) / kNumber - 1)
    throw InputError(name, std::to_string(scans) + " scans", "as many as the file can hold");
  if (scan >= scans)
    throw InputError(name, std::to_string(scans) + " scans", "more than " + std::to_string(scan));
  const std::uint64_t table = size - (scans + 2) * kNumber;
  const std::uint64_t begin = number_at(in, table + scan * kNumber, name);
  const std::uint64_t end = number_at(in, table + (scan + 1) * kNumber, name);
  if (!(kFatesMagic.size() <= begin && begin < end && end <= table))
    throw InputError(name, "scan from byte " + std::to_string(begin) + " to " + std::to_string(end),
                     "bytes before the table at " + std::to_string(table));
  return parse(Runs(read_at(in, begin, end - begin, name), name));
}

}  // namespace stillmap::maps
