#include "units/finished_records.hpp"

#include "pipeline/record_bytes.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <cstring>
#include <span>
#include <stdexcept>
#include <string_view>
#include <type_traits>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Structs that lie in memory as they are written.
template <typename Item>
  requires std::is_trivially_copyable_v<Item>
void put_raw(std::string& bytes, std::span<const Item> items) {
  put(bytes, items.size());
  bytes.append(reinterpret_cast<const char*>(items.data()), items.size_bytes());
}

template <typename Item>
  requires std::is_trivially_copyable_v<Item>
void get_raw(ByteReader& reader, std::vector<Item>& items) {
  items.resize(reader.count(sizeof(Item)));
  const std::string_view bytes = reader.take(items.size() * sizeof(Item));
  if (!items.empty()) std::memcpy(items.data(), bytes.data(), bytes.size());
}

/// Neighbours most often share their fate.
void put_fates(std::string& bytes, const maps::ScanFates& scan) {
  put(bytes, scan.size());
  for (std::size_t i = 0; i < scan.size();) {
    std::size_t end = i + 1;
    while (end < scan.size() && scan.fates[end] == scan.fates[i] &&
           scan.objects[end] == scan.objects[i])
      ++end;
    put_number(bytes, static_cast<std::uint32_t>(end - i));
    put_number(bytes, scan.fates[i]);
    put_number(bytes, scan.objects[i]);
    i = end;
  }
}

void get_fates(ByteReader& reader, maps::ScanFates& scan) {
  const auto size = reader.number<std::size_t>();
  while (scan.size() < size) {
    const auto run = reader.number<std::uint32_t>();
    if (run == 0 || run > size - scan.size()) reader.refuse("a run that is too long");
    scan.fates.insert(scan.fates.end(), run, reader.number<maps::PointFate>());
    scan.objects.insert(scan.objects.end(), run, reader.number<std::uint32_t>());
  }
}

}  // namespace

void FinishedWriter::add(const PlacedScan& scan) {
  std::string bytes;
  put(bytes, std::size_t{scan.voxels.scan()});
  put_fates(bytes, scan.fates);
  put_all(bytes, scan.points_removed);
  put_all(bytes, scan.counts);
  put_all(bytes, scan.stage_seconds);
  journal_.append(bytes);
  ++scans_;
}

void FinishedWriter::add(const FinishedTile& finished) {
  const auto& [tile, evidence, counts, seconds, consistency] = finished;
  std::string bytes;
  put_raw(bytes, std::span(&tile.id, 1));
  put_raw(bytes, std::span(tile.points));
  put_raw(bytes, std::span(tile.history));
  put(bytes, evidence.base_m);
  put_raw(bytes, std::span(evidence.drives));
  put_all(bytes, counts);
  put_all(bytes, seconds);
  consistency.put_into(bytes);
  journal_.append(bytes);
  tiles_.push_back(tile.id);
}

void FinishedWriter::finish() {
  std::string bytes;
  put(bytes, scans_);
  put_raw(bytes, std::span<const maps::TileId>(tiles_));
  journal_.append(bytes);
  journal_.complete();
}

template <typename Read>
auto FinishedReader::read(std::size_t record, const Read& read) const {
  try {
    const std::string bytes = journal_.require(record, unit_);
    ByteReader reader(bytes, fmt::format("record {}", record));
    auto value = read(reader);
    reader.end();
    return value;
  } catch (const std::invalid_argument& error) {
    throw maps::InputError(
        journal_.file().string(), error.what(),
        fmt::format("what the unit '{0}' wrote: remove the file and do --unit {0} again", unit_));
  }
}

FinishedReader::FinishedReader(const BuildJournal& journal, const VoxelGrid& grid, std::string unit)
    : journal_(journal), grid_(grid), unit_(std::move(unit)) {
  const std::size_t last = journal.size() > 0 ? journal.size() - 1 : 0;
  tiles_ = read(last, [&](ByteReader& reader) {
    std::vector<maps::TileId> tiles;
    scans_ = reader.number<std::size_t>();
    get_raw(reader, tiles);
    if (scans_ + tiles.size() != last) reader.refuse("counts of other records");
    return tiles;
  });
}

PlacedScan FinishedReader::next_scan(std::size_t number) {
  return read(next_++, [&](ByteReader& reader) {
    if (next_ > scans_ || reader.number<std::size_t>() != number)
      reader.refuse(fmt::format("not scan {}", number));
    PlacedScan scan(grid_, static_cast<std::uint32_t>(number));
    get_fates(reader, scan.fates);
    get_all(reader, scan.points_removed);
    get_all(reader, scan.counts);
    get_all(reader, scan.stage_seconds);
    return scan;
  });
}

FinishedTile FinishedReader::tile(std::size_t number) const {
  return read(scans_ + number, [&](ByteReader& reader) {
    FinishedTile out;
    std::vector<maps::TileId> id;
    get_raw(reader, id);
    if (id.size() != 1 || id.front() != tiles_.at(number)) reader.refuse("another tile");
    out.tile.id = id.front();
    get_raw(reader, out.tile.points);
    get_raw(reader, out.tile.history);
    get(reader, out.evidence.base_m);
    get_raw(reader, out.evidence.drives);
    get_all(reader, out.counts);
    get_all(reader, out.stage_seconds);
    out.consistency.get_from(reader);
    return out;
  });
}

}  // namespace stillmap::mapping
