#include <stillmap/maps/error.hpp>
#include <stillmap/maps/labelled_boxes.hpp>

#include <utility>

#include <stillmap/maps/text.hpp>
#include "boxes/kitti_calibration.hpp"
#include "boxes/kitti_labels.hpp"

namespace stillmap::maps {
namespace {

namespace fs = std::filesystem;

bool is_json(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  return first != std::string::npos && text[first] == '{';
}

/// What the camera did not label in a scan is taken out of `labels`.
CameraView view_of(const CameraView& camera, KittiLabels& labels, std::size_t scan) {
  CameraView view = camera;
  const auto regions = labels.dont_care.find(scan);
  if (regions != labels.dont_care.end()) view.dont_care = std::move(regions->second);
  return view;
}

LabelledBoxes read_file(const fs::path& file, std::size_t scans) {
  LabelledBoxes out;
  out.source = file;
  const std::string text = read_text(file);
  if (is_json(text)) {
    out.boxes = read_boxes(file, scans);
    return out;
  }
  KittiLabels labels = parse_kitti_labels(file, text, scans);
  const CameraView camera = read_camera_view(file);
  for (std::size_t i = 0; i < scans; ++i) out.views.emplace(i, view_of(camera, labels, i));
  out.boxes = std::move(labels.boxes);
  return out;
}

/// KITTI object: every scan has its own labels and its own calibration.
LabelledBoxes read_object_labels(const fs::path& folder, const Drive& drive) {
  LabelledBoxes out;
  out.source = folder;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const fs::path file = folder / (drive.contents().scan_files[i].stem().string() + ".txt");
    if (!fs::exists(file)) {
      throw InputError(file.string(), "no labels",
                       "a file for each scan, as " + drive.contents().scan_files[i].string());
    }
    KittiLabels labels = parse_kitti_object_labels(file, read_text(file), i);
    out.views.emplace(i, view_of(read_camera_view(file), labels, i));
    out.boxes.by_scan.merge(labels.boxes.by_scan);
    for (const auto& [reason, count] : labels.boxes.dropped) out.boxes.dropped[reason] += count;
  }
  return out;
}

}  // namespace

std::optional<LabelledBoxes> read_labelled_boxes(const Drive& drive,
                                                 const std::optional<fs::path>& boxes_file) {
  if (boxes_file) return read_file(*boxes_file, drive.size());
  const fs::path& root = drive.contents().root;
  for (const char* const name : {"boxes.json", "tracking/label_02.txt"}) {
    if (fs::exists(root / name)) return read_file(root / name, drive.size());
  }
  if (fs::is_directory(root / "label_2")) return read_object_labels(root / "label_2", drive);
  return std::nullopt;
}

}  // namespace stillmap::maps
