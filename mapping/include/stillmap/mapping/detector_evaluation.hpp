#pragma once

#include <stillmap/mapping/label_evaluation.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/maps/drive.hpp>

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::mapping {

struct DetectorEvaluationOptions {
  /// As `make_detector` takes it.
  std::string detector = "voxelnext";
  maps::Selection selection;
  /// Labelled boxes instead of the drive's own, see `maps::read_labelled_boxes`.
  std::optional<std::filesystem::path> boxes_file;
  /// Objects and points beyond it [m, horizontally from the sensor] do not count, > 0.
  double max_range_m = 50.0;
};

/// A place of the curve that a falling threshold of the score draws.
struct PrecisionRecall {
  double score = 0.0, precision = 0.0, recall = 0.0;
};

/// Average precision of one class at one overlap.
struct AveragePrecision {
  /// Shared over joint area of two turned boxes seen from above.
  double iou = 0.0;
  /// Mean of the best precision at 40 recalls or more, 1/40 to 1. NaN without truth.
  double value = 0.0;
  std::vector<PrecisionRecall> curve;
};

/// Labelled objects of one track that were found.
struct TrackRecall {
  /// -1: the labels have no tracks, and each box counts as one of its own.
  int track = -1;
  std::string class_name;
  Share found;
};

/// Labelled objects that were found, a box's centre within 1.5 m.
struct CentreRecall {
  Share found;
  std::vector<TrackRecall> tracks;
  /// Mean over the tracks, so that a car that is seen for long counts once. NaN without truth.
  [[nodiscard]] double by_track() const;
};

/// How boxes stand to the labels of one class, or of one kind: `vehicle` (car, van, truck, bus,
/// trailer, tram), `two_wheeler` (cyclist, motorcycle).
struct ClassDetection {
  std::string name;
  /// Boxes said to be of the class are judged against labels of the class.
  std::vector<AveragePrecision> average_precision;
  /// A box of the kind finds a label of the class: a van found as a car is found.
  CentreRecall all;
  /// Those with 50 or more points within 40 m.
  CentreRecall well_seen;
};

/// Boxes and labels of vehicles when only boxes of a score or more are asked for.
struct ThresholdDetection {
  double score = 0.0;
  Share found, well_seen_found;
  /// Mean over the tracks.
  double well_seen_by_track = 0.0;
  double false_boxes_per_scan = 0.0;
};

/// Vehicles by their distance.
struct DistanceDetection {
  double from_m = 0.0, to_m = 0.0;
  Share found;
  /// At an overlap of 0.5. NaN without truth.
  double average_precision = 0.0;
  double false_boxes_per_scan = 0.0;
};

/// Vehicles when only those count that the scan shows well enough: the fewer points, the less there
/// is to know of a box's size and heading.
struct VisibilityDetection {
  std::size_t min_points = 0;
  Share found;
  /// At an overlap of 0.5. NaN without truth.
  double average_precision = 0.0;
};

/// Boxes against labelled boxes.
struct BoxDetection {
  std::string source;
  /// Whether only what a front camera sees is labelled.
  bool in_camera_only = false;
  /// Truth of fewer points, farther out or of unknown class: neither to be found nor false.
  std::size_t ignored_truths = 0;
  std::size_t boxes = 0, false_vehicles = 0;
  /// Boxes of vehicles that say nothing: out of range, out of the camera's sight, on what does not
  /// count.
  std::size_t ignored_vehicles = 0;
  double false_boxes_per_scan = 0.0;
  /// Kinds first, then classes that occur.
  std::vector<ClassDetection> classes;
  std::vector<ThresholdDetection> thresholds;
  std::vector<DistanceDetection> distances;
  /// By rising number of points; the first is all that counts elsewhere.
  std::vector<VisibilityDetection> visibilities;
  /// With labelled points: what false vehicle boxes hold most of, by class, ground left out.
  std::vector<std::pair<std::string, std::size_t>> false_boxes_hold;
};

/// Points of one class inside of boxes.
struct ClassPoints {
  std::string name;
  bool movable = false;
  Share inside;
};

/// Boxes against labelled points within the range; 0 and 1 never count.
struct PointDetection {
  std::size_t scans = 0;
  Share movable, stays;
  /// Points that stay without those that the ground stage took for ground, which a build keeps.
  Share stays_above_ground;
  /// Moving and parked objects of a class together; classes that occur.
  std::vector<ClassPoints> classes;
};

/// A scan from above, as a PNG file.
struct ScanPicture {
  std::size_t scan = 0;
  std::string png;
};

/// How a detector stands to a labelled drive.
struct DetectorEvaluation {
  DetectorEvaluationOptions options;
  std::size_t scans = 0;
  double seconds = 0.0;
  /// Means of the wall time of one scan: the detector, and the ground stage before it.
  double detect_ms = 0.0, ground_ms = 0.0;
  std::optional<BoxDetection> boxes;
  /// Inside of the boxes as they are.
  std::optional<PointDetection> points;
  /// Inside of the boxes as a build grows them, by `build_margin_m` to every side; where `points`
  /// are.
  std::optional<PointDetection> points_as_built;
  double build_margin_m = 0.0;
  /// When asked for: labels found green, missed red, not counting grey; boxes true blue, false
  /// orange, saying nothing dark blue.
  std::vector<ScanPicture> pictures;
};

/// Judges a detector scan by scan, each scan read and its ground found as a build does (ranges,
/// deskewing, some scans learned from), one after the other, so that the times mean something.
///
/// Truth is `maps::read_labelled_boxes` and SemanticKITTI point labels, whichever there is. A
/// labelled box counts with 5 or more points inside and its centre in range. Like KITTI's "don't
/// care", others are neither missed nor is a box on them false; where a camera's view was labelled,
/// a box is false only with its centre in the image and not half of its outline in a DontCare
/// region.
///
/// Average precision: boxes of falling score take the free label they overlap most (Everingham et
/// al., "The PASCAL VOC Challenge", IJCV 2010; KITTI's 40 recalls: Simonelli et al., "Disentangling
/// Monocular 3D Object Detection", ICCV 2019, section 5). Unlike in KITTI's kit, boxes of equal
/// score are one step of the curve, so that their order is of no account, and a box whose centre
/// lies on a label that does not count says nothing whatever its overlap. Centres: nearest pairs
/// first, one box a label; a second box on it is false.
///
/// @param draw  whether `pictures` are wanted.
/// @throws maps::InputError for a drive without any truth or without selected scans, and what
///         reading throws; std::invalid_argument for broken options; Cancelled.
[[nodiscard]] DetectorEvaluation evaluate_detector(const maps::Drive& drive,
                                                   const DetectorEvaluationOptions& options,
                                                   bool draw, const ProgressCallback& progress,
                                                   const CancelFlag& cancel);

/// The object of `--json`: `AP {class: {iou: value}}`, `recall_centre_1_5m {class: value}`,
/// `false_boxes_per_scan`, `points {movable_recall, static_loss}`, `ms_per_scan` and what they are
/// made of. What could not be known is null.
[[nodiscard]] std::string to_json(const DetectorEvaluation& evaluation);

/// What a report says of itself; plain text, escaped when it is written.
struct DetectorReportHeading {
  std::string drive;
  /// How to make it again.
  std::string command;
};

/// A page of `--report`: one HTML file that needs no other, without scripts.
/// @note  The same evaluation gives the same bytes; only times differ from run to run.
[[nodiscard]] std::string to_html(const DetectorEvaluation& evaluation,
                                  const DetectorReportHeading& heading);

}  // namespace stillmap::mapping
