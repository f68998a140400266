#include "pipeline/posed_drives_bytes.hpp"

#include "core/byte_reader.hpp"

#include <cstdint>
#include <optional>
#include <utility>

namespace stillmap::mapping {
namespace {

maps::Drive drive_from(ByteReader& reader, const maps::Drive& drive) {
  std::optional<maps::GeodeticOrigin> origin;
  if (reader.number<std::uint8_t>() != 0) {
    origin.emplace();
    origin->latitude_deg = reader.number<double>();
    origin->longitude_deg = reader.number<double>();
    origin->altitude_m = reader.number<double>();
  }
  std::vector<Eigen::Isometry3d> poses(drive.size(), Eigen::Isometry3d::Identity());
  for (Eigen::Isometry3d& T : poses) {
    for (Eigen::Index row = 0; row < 3; ++row) {
      for (Eigen::Index column = 0; column < 4; ++column)
        T.matrix()(row, column) = reader.number<double>();
    }
  }
  return drive.with_poses(std::move(poses), origin);
}

void put_place(std::string& bytes, const DriveSet::Place& place) {
  put_number(bytes, place.drive);
  put_number(bytes, place.index);
}

/// A scan of one of the drives.
DriveSet::Place place_from(ByteReader& reader, const std::vector<maps::Drive>& drives) {
  DriveSet::Place place;
  place.drive = reader.number<std::size_t>();
  place.index = reader.number<std::size_t>();
  if (place.drive >= drives.size() || place.index >= drives[place.drive].size())
    reader.refuse("of a scan that is not there");
  return place;
}

void put_graph(std::string& bytes, const DriveGraph& graph) {
  put_number(bytes, graph.key_frames.size());
  for (const DriveSet::Place& place : graph.key_frames) put_place(bytes, place);
  put_number(bytes, graph.loops.size());
  for (const DriveGraph::Loop& loop : graph.loops) {
    put_place(bytes, loop.from);
    put_place(bytes, loop.to);
    put_number(bytes, loop.weight);
  }
}

DriveGraph graph_from(ByteReader& reader, const std::vector<maps::Drive>& drives) {
  DriveGraph graph;
  for (auto left = reader.number<std::size_t>(); left > 0; --left)
    graph.key_frames.push_back(place_from(reader, drives));
  for (auto left = reader.number<std::size_t>(); left > 0; --left) {
    DriveGraph::Loop loop;
    loop.from = place_from(reader, drives);
    loop.to = place_from(reader, drives);
    loop.weight = reader.number<double>();
    graph.loops.push_back(loop);
  }
  return graph;
}

void put_differences(std::string& bytes, const PoseDifferences& apart) {
  put_number(bytes, apart.pairs);
  for (const double value : {apart.way_m, apart.median_m, apart.p95_m, apart.max_m,
                             apart.median_rad, apart.p95_rad, apart.max_rad})
    put_number(bytes, value);
}

PoseDifferences differences_from(ByteReader& reader) {
  PoseDifferences apart;
  apart.pairs = reader.number<std::size_t>();
  for (double* value : {&apart.way_m, &apart.median_m, &apart.p95_m, &apart.max_m,
                        &apart.median_rad, &apart.p95_rad, &apart.max_rad})
    *value = reader.number<double>();
  return apart;
}

void put_report(std::string& bytes, const GivenPosesResult& result) {
  put_number(bytes, static_cast<std::uint8_t>(result.use == GivenPosesUse::kExact));
  put_number(bytes, result.errors.by_way.size());
  for (const PoseDifferences& apart : result.errors.by_way) put_differences(bytes, apart);
  put_differences(bytes, result.errors.loops);
  put_number(bytes, result.errors.sigma_m);
  put_number(bytes, result.errors.sigma_rad);
  put_number(bytes, result.errors.correlated_m);
  put_number(bytes, result.errors.asked);
  put_number(bytes, result.errors.denied);
  put_number(bytes, result.errors.neighbours_m.size());
  for (const double apart_m : result.errors.neighbours_m) put_number(bytes, apart_m);
  put_differences(bytes, result.moved);
}

GivenPosesResult report_from(ByteReader& reader) {
  GivenPosesResult result;
  result.use = reader.number<std::uint8_t>() != 0 ? GivenPosesUse::kExact : GivenPosesUse::kRefine;
  for (auto left = reader.count(8 * sizeof(double)); left > 0; --left)
    result.errors.by_way.push_back(differences_from(reader));
  result.errors.loops = differences_from(reader);
  result.errors.sigma_m = reader.number<double>();
  result.errors.sigma_rad = reader.number<double>();
  result.errors.correlated_m = reader.number<double>();
  result.errors.asked = reader.number<std::size_t>();
  result.errors.denied = reader.number<std::size_t>();
  result.errors.neighbours_m.resize(reader.count(sizeof(double)));
  for (double& apart_m : result.errors.neighbours_m) apart_m = reader.number<double>();
  result.moved = differences_from(reader);
  return result;
}

/// @param lists  one a drive, or none.
template <typename Each>
void require_one_a_scan(const ByteReader& reader, const std::vector<std::vector<Each>>& lists,
                        const std::vector<maps::Drive>& drives) {
  for (std::size_t i = 0; i < lists.size(); ++i)
    if (lists.size() != drives.size() || lists[i].size() != drives[i].size())
      reader.refuse("of other scans than the drives'");
}

void put_text(std::string& bytes, const std::string& text) {
  put_number(bytes, text.size());
  bytes.append(text);
}

std::string text_from(ByteReader& reader) {
  return std::string(reader.take(reader.number<std::size_t>()));
}

}  // namespace

std::string to_bytes(const PosedDrives& posed) {
  std::string bytes;
  put_number(bytes, posed.counts.size());
  for (const auto& [name, count] : posed.counts) {
    put_text(bytes, name);
    put_number(bytes, count);
  }
  put_number(bytes, static_cast<std::uint8_t>(posed.graph.has_value()));
  if (posed.graph) put_graph(bytes, *posed.graph);
  put_number(bytes, static_cast<std::uint8_t>(posed.given.has_value()));
  if (posed.given) put_report(bytes, *posed.given);
  put_number(bytes, posed.faults.size());
  for (const maps::DriveFinding& fault : posed.faults)
    for (const std::string* text : {&fault.code, &fault.what, &fault.remedy})
      put_text(bytes, *text);
  for (const auto* disagreements : {&posed.doubts, &posed.disagreements}) {
    put_number(bytes, disagreements->size());
    for (const std::vector<maps::PoseDisagreement>& of_drive : *disagreements) {
      put_number(bytes, of_drive.size());
      for (const maps::PoseDisagreement& each : of_drive) {
        put_number(bytes, each.m);
        put_number(bytes, each.rad);
      }
    }
  }
  put_number(bytes, posed.remarks.size());
  for (const std::string& remark : posed.remarks) put_text(bytes, remark);
  put_number(bytes, posed.notes.size());
  for (const std::vector<ScanNote>& of_drive : posed.notes) {
    put_number(bytes, of_drive.size());
    for (const ScanNote note : of_drive) put_number(bytes, note);
  }
  put_number(bytes, posed.drives.size());
  for (const maps::Drive& drive : posed.drives) {
    const auto& origin = drive.contents().origin;
    put_number(bytes, static_cast<std::uint8_t>(origin.has_value()));
    if (origin) {
      put_number(bytes, origin->latitude_deg);
      put_number(bytes, origin->longitude_deg);
      put_number(bytes, origin->altitude_m);
    }
    for (const Eigen::Isometry3d& T : drive.contents().T_map_lidar) {
      for (Eigen::Index row = 0; row < 3; ++row) {
        for (Eigen::Index column = 0; column < 4; ++column)
          put_number(bytes, T.matrix()(row, column));
      }
    }
  }
  return bytes;
}

PosedDrives posed_drives_from(std::string_view bytes, const std::vector<maps::Drive>& drives) {
  ByteReader reader(bytes, "poses of drives");
  PosedDrives posed;
  for (auto left = reader.number<std::size_t>(); left > 0; --left) {
    const std::string name = text_from(reader);
    posed.counts[name] = reader.number<std::uint64_t>();
  }
  if (reader.number<std::uint8_t>() != 0) posed.graph = graph_from(reader, drives);
  if (reader.number<std::uint8_t>() != 0) posed.given = report_from(reader);
  for (auto left = reader.count(3 * sizeof(std::size_t)); left > 0; --left) {
    maps::DriveFinding& fault = posed.faults.emplace_back();
    for (std::string* text : {&fault.code, &fault.what, &fault.remedy}) *text = text_from(reader);
  }
  for (auto* disagreements : {&posed.doubts, &posed.disagreements}) {
    for (auto left = reader.count(sizeof(std::size_t)); left > 0; --left) {
      std::vector<maps::PoseDisagreement>& of_drive = disagreements->emplace_back();
      of_drive.resize(reader.count(2 * sizeof(float)));
      for (maps::PoseDisagreement& each : of_drive) {
        each.m = reader.number<float>();
        each.rad = reader.number<float>();
      }
    }
  }
  for (auto left = reader.count(sizeof(std::size_t)); left > 0; --left)
    posed.remarks.push_back(text_from(reader));
  for (auto left = reader.count(sizeof(std::size_t)); left > 0; --left) {
    std::vector<ScanNote>& of_drive = posed.notes.emplace_back();
    of_drive.resize(reader.count(sizeof(ScanNote)));
    for (ScanNote& note : of_drive) note = reader.number<ScanNote>();
  }
  require_one_a_scan(reader, posed.doubts, drives);
  require_one_a_scan(reader, posed.disagreements, drives);
  require_one_a_scan(reader, posed.notes, drives);
  if (reader.number<std::size_t>() != drives.size()) reader.refuse("of another number of drives");
  for (const maps::Drive& drive : drives) posed.drives.push_back(drive_from(reader, drive));
  reader.end();
  return posed;
}

}  // namespace stillmap::mapping
