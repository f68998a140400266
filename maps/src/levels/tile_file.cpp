#include "levels/tile_file.hpp"

#include <stillmap/maps/crc32c.hpp>
#include <stillmap/maps/error.hpp>

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <set>
#include <stdexcept>
#include <utility>

namespace stillmap::maps {
namespace {

constexpr SectionFormat kTileFile = {
    {'s', 't', 'i', 'l', 'l', 't', 'l', 's'}, 3, alignof(float), "a file of tiles"};
constexpr std::size_t kMostKeyBytes = 1024;

/// What a section holds, in the order in which they lie.
enum TileSection : std::uint32_t {
  kPoints = 1,  ///< MapPoint, from its tile's corner; the rows say which are of which tile
  kRows = 2,    ///< TileRow
  kKey = 3,     ///< what the file was made from, a text
};
constexpr std::size_t kSections = 3;
constexpr std::size_t kTileFileHead = section_table_end(kSections);
static_assert(sizeof(MapPoint) % alignof(float) == 0);

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
  if (key_.size() > kMostKeyBytes)
    throw std::invalid_argument("key of " + std::to_string(key_.size()) + " bytes");
  file_.append(std::vector<std::byte>(kTileFileHead));
}

void TileFileWriter::add(TileId id, std::span<const MapPoint> points, std::uint32_t seen_free) {
  if (!rows_.empty() && !before(rows_.back(), id))
    throw std::invalid_argument("tiles out of their order");
  TileRow row = row_of(id, points);
  row.seen_free = seen_free;
  row.offset = file_.size();
  file_.append(std::as_bytes(points));
  points_crc_ = crc32c(std::as_bytes(points), points_crc_);
  rows_.push_back(row);
}

std::vector<MapPoint> TileFileWriter::read(const TileRow& row) const {
  std::vector<MapPoint> points(row.points);
  file_.read(row.offset, std::as_writable_bytes(std::span(points)));
  return points;
}

void TileFileWriter::publish() {
  const auto rows = std::as_bytes(std::span(rows_));
  const auto key = std::as_bytes(std::span(key_));
  const std::uint64_t end_of_points = file_.size();
  std::array<Section, kSections> sections{Section{.kind = kPoints,
                                                  .offset = kTileFileHead,
                                                  .bytes = end_of_points - kTileFileHead,
                                                  .item_bytes = sizeof(MapPoint),
                                                  .crc = points_crc_},
                                          section_part(kRows, 0, rows, sizeof(TileRow)).section,
                                          section_part(kKey, 0, key, 1).section};
  sections[1].offset = end_of_points;
  sections[2].offset = end_of_points + rows.size();
  file_.append(rows);
  file_.append(key);
  const SectionHeader header = sealed(kTileFile, {}, sections, file_.size());
  file_.overwrite(0, std::as_bytes(std::span(&header, 1)));
  file_.overwrite(sizeof(header), std::as_bytes(std::span(sections)));
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

void TileFile::read_section(const Section& section, std::span<std::byte> to) const {
  read_all(section.offset, to);
  if (crc32c(to) != section.crc)
    throw InputError(file_.string(), "a table that does not fit its checksum", "an undamaged one");
}

void TileFile::load(const std::string& key) {
  struct stat status {};
  if (::fstat(descriptor_, &status) != 0) throw StorageError(file_.string(), std::strerror(errno));
  if (!S_ISREG(status.st_mode)) throw InputError(file_.string(), "no file", kTileFile.what);
  const auto bytes = static_cast<std::uint64_t>(status.st_size);
  std::vector<std::byte> head(std::min<std::uint64_t>(bytes, kTileFileHead));
  read_all(0, head);
  const SectionTable table(head, bytes, kTileFile, file_.string());
  const auto refuse = [&](const std::string& found, const std::string& expected) {
    table.refuse(found, expected);
  };
  const Section* points = table.find(kPoints, 0);
  const Section* rows = table.find(kRows, 0);
  const Section* made_from = table.find(kKey, 0);
  if (points == nullptr || rows == nullptr || made_from == nullptr ||
      rows->bytes % sizeof(TileRow) != 0 || made_from->bytes > kMostKeyBytes)
    refuse("other sections", "points, rows and a key");
  std::string found_key(made_from->bytes, '\0');
  read_section(*made_from, std::as_writable_bytes(std::span(found_key)));
  if (found_key != key) refuse("what was made from something else", "'" + key + "'");
  rows_.resize(rows->bytes / sizeof(TileRow));
  read_section(*rows, std::as_writable_bytes(std::span(rows_)));
  const std::uint64_t end = points->offset + points->bytes;
  for (const TileRow& row : rows_) {
    const std::uint64_t room = end - std::min(row.offset, end);
    if (row.offset < points->offset || row.points == 0 || row.points > room / sizeof(MapPoint))
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
