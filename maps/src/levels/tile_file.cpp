#include "levels/tile_file.hpp"

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <set>
#include <stdexcept>
#include <utility>

namespace stillmap::maps {
namespace {

static_assert(std::endian::native == std::endian::little, "tile files are little endian");

/// Counts up whenever a reader, or what the same map is made into, would differ.
constexpr std::uint32_t kTileFormat = 1;

struct TileHeader {
  std::array<char, 8> magic = {'s', 't', 'i', 'l', 'l', 't', 'l', 's'};
  std::uint32_t format = kTileFormat;
  /// CRC-32C of header and table, this field taken as 0.
  std::uint32_t crc = 0;
  std::uint64_t file_bytes = 0;
  std::uint64_t table_offset = 0;
  std::uint64_t tiles = 0;
  std::array<char, TileFile::kMostKeyBytes> key{};
};
static_assert(sizeof(TileHeader) == 256);

std::uint32_t crc_of(TileHeader header, std::span<const TileRow> rows) {
  header.crc = 0;
  return crc32c(std::as_bytes(rows), crc32c(std::as_bytes(std::span(&header, 1))));
}

TileHeader header_for(const std::string& key) {
  if (key.size() > TileFile::kMostKeyBytes)
    throw std::invalid_argument("key of " + std::to_string(key.size()) + " bytes");
  TileHeader header;
  std::copy(key.begin(), key.end(), header.key.begin());
  return header;
}

std::uint32_t squares_of(std::span<const MapPoint> points) {
  std::set<std::pair<float, float>> squares;
  std::pair<float, float> last{std::nanf(""), 0.0F};
  for (const MapPoint& p : points) {
    const std::pair square(std::floor(p.x), std::floor(p.y));
    // Neighbours in a tile are mostly neighbours on the ground.
    if (square != last) squares.insert(square);
    last = square;
  }
  return static_cast<std::uint32_t>(squares.size());
}

TileRow row_of(TileId id, std::span<const MapPoint> points) {
  if (points.empty()) throw std::invalid_argument("a tile without points");
  TileRow row{.group = id.level, .x = id.x, .y = id.y, .points = points.size()};
  row.crc = crc32c(std::as_bytes(points));
  row.min = {points[0].x, points[0].y, points[0].z};
  row.max = row.min;
  for (const MapPoint& p : points) {
    const std::array<float, 3> xyz{p.x, p.y, p.z};
    for (std::size_t axis = 0; axis < xyz.size(); ++axis) {
      row.min[axis] = std::min(row.min[axis], xyz[axis]);
      row.max[axis] = std::max(row.max[axis], xyz[axis]);
    }
    const auto kind = static_cast<std::size_t>(p.kind);
    if (kind < row.kinds.size()) ++row.kinds[kind];
  }
  row.squares = squares_of(points);
  return row;
}

bool before(const TileRow& row, TileId id) { return row.id() < id; }

}  // namespace

TileFileWriter::TileFileWriter(const std::filesystem::path& file, std::string key)
    : file_(file), key_(std::move(key)) {
  const TileHeader header = header_for(key_);
  file_.append(std::as_bytes(std::span(&header, 1)));
}

void TileFileWriter::add(TileId id, std::span<const MapPoint> points) {
  if (!rows_.empty() && !before(rows_.back(), id))
    throw std::invalid_argument("tiles out of their order");
  TileRow row = row_of(id, points);
  row.offset = file_.size();
  file_.append(std::as_bytes(points));
  rows_.push_back(row);
}

std::vector<MapPoint> TileFileWriter::read(const TileRow& row) const {
  std::vector<MapPoint> points(row.points);
  file_.read(row.offset, std::as_writable_bytes(std::span(points)));
  return points;
}

void TileFileWriter::publish() {
  TileHeader header = header_for(key_);
  header.table_offset = file_.size();
  header.tiles = rows_.size();
  header.file_bytes = file_.size() + rows_.size() * sizeof(TileRow);
  header.crc = crc_of(header, rows_);
  file_.append(std::as_bytes(std::span(rows_)));
  file_.overwrite(0, std::as_bytes(std::span(&header, 1)));
  file_.publish();
}

TileFile::TileFile(std::filesystem::path file, const std::string& key)
    : file_(std::move(file)), descriptor_(::open(file_.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (descriptor_ < 0) throw StorageError(file_.string(), std::strerror(errno));
  try {
    load(key);
  } catch (...) {
    ::close(descriptor_);
    throw;
  }
}

TileFile::~TileFile() { ::close(descriptor_); }

void TileFile::read_all(std::uint64_t offset, std::span<std::byte> to) const {
  while (!to.empty()) {
    const ssize_t got = ::pread(descriptor_, to.data(), to.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) throw StorageError(file_.string(), std::strerror(errno));
    if (got == 0) throw InputError(file_.string(), "a shorter file", "what its header states");
    offset += static_cast<std::uint64_t>(got);
    to = to.subspan(static_cast<std::size_t>(got));
  }
}

void TileFile::load(const std::string& key) {
  const auto refuse = [this](const std::string& found, const std::string& expected) {
    throw InputError(file_.string(), found, expected);
  };
  struct stat status {};
  if (::fstat(descriptor_, &status) != 0) throw StorageError(file_.string(), std::strerror(errno));
  const auto bytes = static_cast<std::uint64_t>(status.st_size);
  TileHeader header;
  const TileHeader wanted = header_for(key);
  if (!S_ISREG(status.st_mode) || bytes < sizeof(header)) refuse("no tile file", "one");
  read_all(0, std::as_writable_bytes(std::span(&header, 1)));
  if (header.magic != wanted.magic) refuse("no tile file", "one");
  if (header.format != kTileFormat)
    refuse("format " + std::to_string(header.format), std::to_string(kTileFormat));
  if (header.file_bytes != bytes)
    refuse(std::to_string(bytes) + " bytes", std::to_string(header.file_bytes));
  if (header.table_offset < sizeof(header) || header.table_offset > bytes ||
      header.tiles != (bytes - header.table_offset) / sizeof(TileRow) ||
      (bytes - header.table_offset) % sizeof(TileRow) != 0) {
    refuse("a table at " + std::to_string(header.table_offset), "one at the end");
  }
  rows_.resize(header.tiles);
  read_all(header.table_offset, std::as_writable_bytes(std::span(rows_)));
  if (crc_of(header, rows_) != header.crc)
    refuse("header and table that do not fit their checksum", "undamaged ones");
  if (header.key != wanted.key) refuse("what was made from something else", "'" + key + "'");
  for (const TileRow& row : rows_) {
    const std::uint64_t room = header.table_offset - std::min(row.offset, header.table_offset);
    if (row.offset < sizeof(header) || row.points == 0 || row.points > room / sizeof(MapPoint))
      refuse("a tile beyond the end", "one within the file");
  }
  if (!std::is_sorted(rows_.begin(), rows_.end(),
                      [](const TileRow& a, const TileRow& b) { return a.id() < b.id(); }))
    refuse("tiles out of their order", "sorted ones");
}

const TileRow* TileFile::find(TileId id) const {
  const auto found = std::lower_bound(rows_.begin(), rows_.end(), id, before);
  return found != rows_.end() && found->id() == id ? &*found : nullptr;
}

std::vector<MapPoint> TileFile::read(const TileRow& row) const {
  std::vector<MapPoint> points(row.points);
  read_all(row.offset, std::as_writable_bytes(std::span(points)));
  if (crc32c(std::as_bytes(std::span(points))) != row.crc) {
    throw InputError(file_.string(),
                     "points of tile " + std::to_string(row.group) + "/" + std::to_string(row.x) +
                         "/" + std::to_string(row.y) + " that do not fit their checksum",
                     "undamaged ones");
  }
  return points;
}

}  // namespace stillmap::maps
