#include "units/fused_records.hpp"

#include "ground/ground_sheets.hpp"
#include "pipeline/build_key.hpp"
#include "pipeline/manifest.hpp"
#include "pipeline/record_bytes.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::mapping {

static void put(std::string& bytes, const ObjectPlacement& placement) {
  const auto& [scan, box, detected] = placement;
  put_each(bytes, scan, box, detected);
}

static void get(ByteReader& reader, ObjectPlacement& placement) {
  auto& [scan, box, detected] = placement;
  get_each(reader, scan, box, detected);
}

static void put(std::string& bytes, const FusedObject& object) {
  const auto& [object_class, size_m, existence, moving, placements] = object;
  put_each(bytes, object_class, size_m, existence, moving);
  put_all(bytes, placements);
}

static void get(ByteReader& reader, FusedObject& object) {
  auto& [object_class, size_m, existence, moving, placements] = object;
  get_each(reader, object_class, size_m, existence, moving);
  get_all(reader, placements);
}

namespace {

/// A record of ground: some megabyte.
constexpr std::size_t kSheetsOfRecord = 256;

/// All but the ground.
std::string objects_record(const Build& build) {
  const Survey& survey = *build.survey;
  const auto& [applied, kept, unmatched] = build.objects.edits;
  std::string bytes;
  put_each(bytes, survey.sources, survey.box_count);
  put_all(bytes, survey.counts);
  put_all(bytes, survey.stage_seconds);
  put_all(bytes, build.objects.objects);
  put(bytes, applied);
  put_all(bytes, kept);
  put_all(bytes, unmatched);
  return bytes;
}

void take_objects(Build& build, std::string_view bytes) {
  ByteReader reader(bytes, "fused objects");
  Survey& survey = *build.survey;
  std::vector<FusedObject> objects;
  EditResult edits;
  get_each(reader, survey.sources, survey.box_count);
  get_all(reader, survey.counts);
  get_all(reader, survey.stage_seconds);
  get_all(reader, objects);
  get(reader, edits.applied);
  get_all(reader, edits.kept);
  get_all(reader, edits.unmatched, sizeof(std::size_t));
  reader.end();
  for (const FusedObject& object : objects) {
    for (const ObjectPlacement& placement : object.placements)
      if (placement.scan >= build.drives->size()) reader.refuse("an object in no scan");
  }
  build.objects = in_scans(build, std::move(objects), std::move(edits));
}

/// Sheets of an area, with numbers of their own.
class SomeSheets {
 public:
  SomeSheets(const Eigen::AlignedBox2d& area, const std::filesystem::path& scratch)
      : area_(area), sheets_(scratch) {}

  void take(std::string_view bytes) {
    constexpr std::size_t kBytes = sizeof(GroundSheets::Sheet);
    if (bytes.size() % kBytes != 0) throw std::invalid_argument("ground: half a sheet");
    for (; !bytes.empty(); bytes.remove_prefix(kBytes)) {
      GroundSheets::Sheet sheet;
      std::memcpy(&sheet, bytes.data(), kBytes);
      constexpr double kBlockM = GroundSheets::kSide * kGroundCellM;
      const Eigen::Vector2d corner = kBlockM * Eigen::Vector2d(sheet.block_x, sheet.block_y);
      const Eigen::AlignedBox2d block(corner, corner + Eigen::Vector2d::Constant(kBlockM));
      number_here_.push_back(area_.intersects(block) ? add(sheet) : GroundSheets::kNone);
    }
  }

  GroundSheets finish() && {
    for (std::size_t i = 0; i < sheets_.size(); ++i) {
      for (std::uint32_t& around : sheets_[i].around)
        if (around != GroundSheets::kNone) around = number_here_.at(around);
      if (maps::rests_after(i)) sheets_.rest();
    }
    return std::move(sheets_);
  }

 private:
  std::uint32_t add(const GroundSheets::Sheet& sheet) {
    const std::uint32_t number = sheets_.add(sheet.block_x, sheet.block_y);
    sheets_[number] = sheet;
    return number;
  }

  Eigen::AlignedBox2d area_;
  GroundSheets sheets_;
  /// By the number that a sheet had where it was finished.
  std::vector<std::uint32_t> number_here_;
};

void write_ground(const GroundSheets& sheets, BuildJournal& journal) {
  std::string bytes;
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    bytes.append(reinterpret_cast<const char*>(&sheets[i]), sizeof(GroundSheets::Sheet));
    const bool is_last = i + 1 == sheets.size();
    if (!is_last && (i + 1) % kSheetsOfRecord != 0) continue;
    journal.append(bytes);
    bytes.clear();
    sheets.rest();
  }
}

}  // namespace

std::string fused_key(const Build& build, const SurveyRecords& records, std::size_t units) {
  const BuildTask& task = build.task;
  std::string key = fmt::format("survey: {}\nunits: {}\n", records.sum(), units);
  key += rebuild_key(task.drives, task.options, task.odometry);
  return key;
}

void write_fused(const Build& build, BuildJournal& journal) {
  journal.append(objects_record(build));
  write_ground(build.survey->ground.sheets(), journal);
  journal.complete();
}

void read_fused(Build& build, const BuildJournal& journal,
                const std::optional<Eigen::AlignedBox2d>& ground) {
  constexpr std::string_view kUnit = "fuse";
  build.survey = std::make_unique<Survey>(build.task.scratch);
  try {
    take_objects(build, journal.require(0, kUnit));
    if (!ground) return;
    SomeSheets sheets(*ground, build.task.scratch);
    for (std::size_t record = 1; record < journal.size(); ++record)
      sheets.take(journal.require(record, kUnit));
    build.survey->ground.take(std::move(sheets).finish());
  } catch (const std::invalid_argument& error) {
    throw maps::InputError(journal.file().string(), error.what(),
                           "what the unit 'fuse' wrote: remove the file and do --unit fuse again");
  }
}

}  // namespace stillmap::mapping
