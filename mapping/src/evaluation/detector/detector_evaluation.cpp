#include <stillmap/mapping/detector_evaluation.hpp>

#include "core/seconds_since.hpp"
#include "core/top_view.hpp"
#include "drives/drive_set.hpp"
#include "evaluation/detector/box_figures.hpp"
#include "evaluation/detector/point_tally.hpp"

#include <fmt/format.h>
#include <stillmap/mapping/detector.hpp>
#include <stillmap/mapping/ground.hpp>
#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/labelled_boxes.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <memory>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// By how much a build grows the boxes of a detector.
double build_margin_m(const std::string& detector) {
  MapBuildOptions options;
  options.detector = detector;
  return completed(options).projection.margin_m;
}

using Clock = std::chrono::steady_clock;

/// Scans that the ground stage learns from, as a build does.
constexpr std::size_t kLearnedScans = 10;
/// Spread over the scans.
constexpr std::size_t kPictures = 6;
constexpr int kPicturePixels = 800;

constexpr Colour kFoundTruth{60, 220, 90}, kMissedTruth{255, 60, 60}, kIgnoredTruth{130, 130, 130};
constexpr Colour kTrueBox{90, 170, 255}, kFalseBox{255, 150, 40}, kIgnoredBox{50, 80, 130};

std::size_t points_in(const maps::Box& box, const maps::PointCloud& cloud) {
  const double reach_m = 0.5 * box.size_m.norm();
  const Eigen::Vector3f centre = box.centre.cast<float>();
  const auto reach2 = static_cast<float>(reach_m * reach_m * 1.01);
  return static_cast<std::size_t>(
      std::count_if(cloud.positions.begin(), cloud.positions.end(), [&](const Eigen::Vector3f& p) {
        return (p - centre).squaredNorm() <= reach2 && box.contains(p.cast<double>());
      }));
}

/// Takes the scans of a drive one by one, then the figures of all.
class DetectorJudge {
 public:
  DetectorJudge(const maps::Drive& drive, const DetectorEvaluationOptions& options,
                const CancelFlag& cancel)
      : drive_(drive),
        options_(options),
        cancel_(cancel),
        scans_(options.selection.indices(drive.size())),
        truth_(maps::read_labelled_boxes(drive, options.boxes_file)),
        build_margin_m_(build_margin_m(options.detector)),
        points_(options.max_range_m, 0.0),
        points_as_built_(options.max_range_m, build_margin_m_),
        detector_(make_detector(options.detector, drive.size())),
        ground_(make_ground_segmenter()) {
    check_truth();
    learn_ground();
  }

  DetectorEvaluation judge(bool draw, const ProgressCallback& progress) {
    const Clock::time_point began = Clock::now();
    for (std::size_t i = 0; i < scans_.size(); ++i) {
      if (cancel_) throw Cancelled();
      judge_scan(scans_[i], draw && is_drawn(i));
      if (progress) progress("detect", i + 1, scans_.size());
    }
    finish();
    result_.seconds = seconds_since(began);
    return std::move(result_);
  }

 private:
  void check_truth() const {
    const std::string folder = drive_.contents().root.string();
    if (scans_.empty())
      throw maps::InputError(folder, fmt::format("{} scans, none selected", drive_.size()),
                             "at least one: change --select");
    if (!truth_ && drive_.contents().label_files.empty()) {
      throw maps::InputError(folder, "a drive without labels",
                             "boxes.json, tracking/label_02.txt, label_2/*.txt or labels/*.label, "
                             "or a file given with --boxes");
    }
  }

  [[nodiscard]] maps::Scan read(std::size_t index) const {
    const MapBuildOptions build;
    std::map<std::string, std::uint64_t> unused;
    return read_deskewed(drive_, index, {build.min_range_m, build.max_range_m}, unused);
  }

  void learn_ground() {
    const std::size_t learned = std::min(kLearnedScans, scans_.size());
    for (std::size_t i = 0; i < learned; ++i) {
      if (cancel_) throw Cancelled();
      const maps::Scan scan = read(scans_[i * scans_.size() / learned]);
      if (!scan.cloud.empty()) ground_->learn(scan.cloud);
    }
  }

  [[nodiscard]] bool is_drawn(std::size_t place) const {
    const std::size_t pictures = std::min(kPictures, scans_.size());
    for (std::size_t i = 0; i < pictures; ++i) {
      if (place == i * scans_.size() / pictures) return true;
    }
    return false;
  }

  void judge_scan(std::size_t index, bool draw) {
    const maps::Scan scan = read(index);
    GroundResult ground;
    std::vector<maps::Box> found;
    {
      const Clock::time_point began = Clock::now();
      ground = ground_->segment(scan.cloud);
      result_.ground_ms += 1e3 * seconds_since(began);
    }
    // As in a build, detectors meet no empty scan.
    if (!scan.cloud.empty()) {
      const Clock::time_point began = Clock::now();
      found = detector_->detect(scan, ground);
      result_.detect_ms += 1e3 * seconds_since(began);
    }
    const std::vector<std::uint32_t> labels = drive_.read_labels(index);
    std::vector<ClassIndex> classes;
    if (!labels.empty()) {
      classes = classes_of(scan, labels);
      points_.add(scan.cloud, classes, ground.is_ground, found);
      points_as_built_.add(scan.cloud, classes, ground.is_ground, found);
    }
    if (truth_)
      judge_boxes(scan, std::move(found), classes, ground, draw);
    else if (draw)
      draw_scan(scan, {.scan = index, .truths = {}, .found = std::move(found), .in_sight = {}}, {});
  }

  void judge_boxes(const maps::Scan& scan, std::vector<maps::Box> found,
                   const std::vector<ClassIndex>& classes, const GroundResult& ground, bool draw) {
    ScanBoxes boxes;
    boxes.scan = scan.index;
    boxes.found = std::move(found);
    const auto labelled = truth_->boxes.by_scan.find(scan.index);
    if (labelled != truth_->boxes.by_scan.end()) {
      for (const maps::Box& box : labelled->second)
        boxes.truths.push_back({box, points_in(box, scan.cloud)});
    }
    const auto view = truth_->views.find(scan.index);
    for (const maps::Box& box : boxes.found) {
      const bool seen = view == truth_->views.end() || would_be_labelled(box, view->second);
      boxes.in_sight.push_back(seen ? 1 : 0);
    }
    if (!classes.empty()) tell_false_boxes(scan, boxes, classes, ground);
    if (draw) draw_scan(scan, boxes, matches_of_all_kinds(boxes));
    boxes_.push_back(std::move(boxes));
  }

  void tell_false_boxes(const maps::Scan& scan, const ScanBoxes& boxes,
                        const std::vector<ClassIndex>& classes, const GroundResult& ground) {
    const ScanMatch match = match_by_centre(boxes, kinds()[0], whole_window(options_.max_range_m));
    for (std::size_t i = 0; i < boxes.found.size(); ++i) {
      if (match.verdicts[i] == Verdict::kFalse)
        ++false_boxes_hold_[content_of(boxes.found[i], scan.cloud, classes, ground.is_ground)];
    }
  }

  [[nodiscard]] ScanMatch matches_of_all_kinds(const ScanBoxes& boxes) const {
    ScanMatch all;
    all.counts.assign(boxes.truths.size(), 0);
    all.is_found.assign(boxes.truths.size(), 0);
    all.verdicts.assign(boxes.found.size(), Verdict::kIgnored);
    for (const ClassGroup& kind : kinds()) {
      const ScanMatch match = match_by_centre(boxes, kind, whole_window(options_.max_range_m));
      for (std::size_t i = 0; i < match.counts.size(); ++i) {
        if (match.counts[i] == 0) continue;
        all.counts[i] = 1;
        all.is_found[i] = match.is_found[i];
      }
      for (std::size_t i = 0; i < match.verdicts.size(); ++i) {
        if (match.verdicts[i] != Verdict::kOther) all.verdicts[i] = match.verdicts[i];
      }
    }
    return all;
  }

  /// Without labelled boxes all boxes are drawn as saying nothing.
  void draw_scan(const maps::Scan& scan, const ScanBoxes& boxes, const ScanMatch& match) {
    const Eigen::Vector2d corner = Eigen::Vector2d::Constant(options_.max_range_m);
    TopView view(-corner, corner, kPicturePixels);
    for (const Eigen::Vector3f& p : scan.cloud.positions) view.add_point(p.cast<double>());
    const Eigen::Isometry3d here = Eigen::Isometry3d::Identity();
    for (std::size_t i = 0; i < boxes.truths.size(); ++i) {
      const Colour judged = match.is_found[i] != 0 ? kFoundTruth : kMissedTruth;
      view.add_box(boxes.truths[i].box, here, match.counts[i] != 0 ? judged : kIgnoredTruth);
    }
    for (std::size_t i = 0; i < boxes.found.size(); ++i) {
      const Verdict verdict = match.verdicts.empty() ? Verdict::kIgnored : match.verdicts[i];
      const Colour judged = verdict == Verdict::kTrue ? kTrueBox : kFalseBox;
      view.add_box(boxes.found[i], here, verdict == Verdict::kIgnored ? kIgnoredBox : judged);
    }
    result_.pictures.push_back({scan.index, view.png()});
  }

  void finish() {
    result_.options = options_;
    result_.scans = scans_.size();
    result_.detect_ms /= static_cast<double>(scans_.size());
    result_.ground_ms /= static_cast<double>(scans_.size());
    if (truth_) {
      result_.boxes = box_figures(boxes_, options_.max_range_m);
      result_.boxes->source = truth_->source.string();
      result_.boxes->in_camera_only = !truth_->views.empty();
      result_.boxes->false_boxes_hold.assign(false_boxes_hold_.begin(), false_boxes_hold_.end());
      std::stable_sort(result_.boxes->false_boxes_hold.begin(),
                       result_.boxes->false_boxes_hold.end(),
                       [](const auto& a, const auto& b) { return a.second > b.second; });
    }
    PointDetection points = points_.result();
    if (points.scans == 0) return;
    result_.points = std::move(points);
    result_.points_as_built = points_as_built_.result();
    result_.build_margin_m = build_margin_m_;
  }

  const maps::Drive& drive_;
  const DetectorEvaluationOptions& options_;
  const CancelFlag& cancel_;
  std::vector<std::size_t> scans_;
  std::optional<maps::LabelledBoxes> truth_;
  double build_margin_m_;
  PointTally points_, points_as_built_;
  std::unique_ptr<Detector> detector_;
  std::unique_ptr<GroundSegmenter> ground_;
  std::vector<ScanBoxes> boxes_;
  std::map<std::string, std::size_t> false_boxes_hold_;
  DetectorEvaluation result_;
};

}  // namespace

DetectorEvaluation evaluate_detector(const maps::Drive& drive,
                                     const DetectorEvaluationOptions& options, bool draw,
                                     const ProgressCallback& progress, const CancelFlag& cancel) {
  if (!(options.max_range_m > 0.0) || !std::isfinite(options.max_range_m))
    throw std::invalid_argument(fmt::format(
        "max_range_m (--max-range): found {}, expected more than 0", options.max_range_m));
  return DetectorJudge(drive, options, cancel).judge(draw, progress);
}

}  // namespace stillmap::mapping
