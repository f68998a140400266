#include "evaluation/detector/box_figures.hpp"

#include "evaluation/detector/precision_recall.hpp"

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <utility>

namespace stillmap::mapping {
namespace {

/// What nobody would miss by eye.
constexpr std::size_t kWellSeenPoints = 50;
constexpr double kWellSeenRangeM = 40.0;
constexpr std::array<double, 4> kBandsM{0.0, 20.0, 40.0, 50.0};
constexpr std::array<std::size_t, 5> kLeastPoints{5, 10, 20, 50, 100};
constexpr int kThresholds = 20;
constexpr double kBandIou = 0.5;

void add(Share& share, bool found) {
  share.count += found ? 1 : 0;
  ++share.of;
}

/// Found labels by track; those without a track are one each.
class TrackTally {
 public:
  void add(const maps::Box& truth, bool found) {
    mapping::add(recall_.found, found);
    const auto known = truth.track < 0 ? places_.end() : places_.find(truth.track);
    std::size_t place = recall_.tracks.size();
    if (known != places_.end()) {
      place = known->second;
    } else {
      recall_.tracks.push_back({truth.track, std::string(name_of(truth.object_class)), {}});
      if (truth.track >= 0) places_.emplace(truth.track, place);
    }
    mapping::add(recall_.tracks[place].found, found);
  }

  [[nodiscard]] CentreRecall take() {
    std::stable_sort(recall_.tracks.begin(), recall_.tracks.end(),
                     [](const TrackRecall& a, const TrackRecall& b) { return a.track < b.track; });
    return std::move(recall_);
  }

 private:
  CentreRecall recall_;
  std::map<int, std::size_t> places_;
};

bool is_well_seen(const TruthBox& truth) {
  return truth.points >= kWellSeenPoints && truth.box.centre.head<2>().norm() < kWellSeenRangeM;
}

/// All scans of one kind, matched by centre.
class CentreMatches {
 public:
  CentreMatches(const std::vector<ScanBoxes>& scans, const ClassGroup& kind, const Window& window,
                double min_score)
      : scans_(scans) {
    for (const ScanBoxes& scan : scans)
      matches_.push_back(match_by_centre(scan, kind, window, min_score));
  }

  /// Of the truth that counts and that `among` holds of.
  template <typename Among>
  [[nodiscard]] CentreRecall recall(const Among& among) const {
    TrackTally tally;
    for (std::size_t s = 0; s < scans_.size(); ++s) {
      const ScanMatch& match = matches_[s];
      for (std::size_t i = 0; i < match.counts.size(); ++i) {
        const TruthBox& truth = scans_[s].truths[i];
        if (match.counts[i] != 0 && among(truth)) tally.add(truth.box, match.is_found[i] != 0);
      }
    }
    return tally.take();
  }

  /// Boxes of a verdict that `among` holds of.
  template <typename Among>
  [[nodiscard]] std::size_t count(Verdict verdict, const Among& among) const {
    std::size_t count = 0;
    for (std::size_t s = 0; s < scans_.size(); ++s) {
      for (std::size_t i = 0; i < matches_[s].verdicts.size(); ++i)
        count += matches_[s].verdicts[i] == verdict && among(scans_[s].found[i]) ? 1 : 0;
    }
    return count;
  }
  [[nodiscard]] std::size_t count(Verdict verdict) const {
    return count(verdict, [](const maps::Box&) { return true; });
  }

  [[nodiscard]] double false_per_scan() const { return per_scan(count(Verdict::kFalse)); }
  [[nodiscard]] double per_scan(std::size_t boxes) const {
    return static_cast<double>(boxes) / static_cast<double>(scans_.size());
  }

 private:
  const std::vector<ScanBoxes>& scans_;
  std::vector<ScanMatch> matches_;
};

ClassDetection class_figures(const std::vector<ScanBoxes>& scans, const ClassGroup& group,
                             const Window& window) {
  ClassDetection out;
  out.name = group.name;
  for (const double iou : group.ious)
    out.average_precision.push_back(average_precision(scans, group, window, iou));
  const CentreMatches matches(scans, kind_of(group), window, 0.0);
  out.all =
      matches.recall([&](const TruthBox& truth) { return group.holds(truth.box.object_class); });
  out.well_seen = matches.recall([&](const TruthBox& truth) {
    return group.holds(truth.box.object_class) && is_well_seen(truth);
  });
  return out;
}

ThresholdDetection at_threshold(const std::vector<ScanBoxes>& scans, const Window& window,
                                double score) {
  const CentreMatches matches(scans, kinds()[0], window, score);
  const CentreRecall well_seen = matches.recall(is_well_seen);
  return {score, matches.recall([](const TruthBox&) { return true; }).found, well_seen.found,
          well_seen.by_track(), matches.false_per_scan()};
}

std::vector<DistanceDetection> by_distance(const std::vector<ScanBoxes>& scans,
                                           const CentreMatches& vehicles, double max_range_m) {
  std::vector<DistanceDetection> bands;
  for (std::size_t i = 0; i + 1 < kBandsM.size(); ++i) {
    const Window band{kBandsM[i], std::min(kBandsM[i + 1], max_range_m)};
    if (!(band.to_m > band.from_m)) break;
    const auto here = [&](const TruthBox& truth) { return band.holds(truth.box); };
    DistanceDetection out;
    out.from_m = band.from_m;
    out.to_m = band.to_m;
    out.found = vehicles.recall(here).found;
    out.average_precision = average_precision(scans, kinds()[0], band, kBandIou).value;
    out.false_boxes_per_scan = vehicles.per_scan(
        vehicles.count(Verdict::kFalse, [&](const maps::Box& box) { return band.holds(box); }));
    bands.push_back(out);
  }
  return bands;
}

std::vector<VisibilityDetection> by_visibility(const std::vector<ScanBoxes>& scans,
                                               const Window& window) {
  std::vector<VisibilityDetection> out;
  for (const std::size_t least : kLeastPoints) {
    Window visible = window;
    visible.min_points = least;
    const CentreMatches vehicles(scans, kinds()[0], visible, 0.0);
    out.push_back({least, vehicles.recall([](const TruthBox&) { return true; }).found,
                   average_precision(scans, kinds()[0], visible, kBandIou).value});
  }
  return out;
}

bool occurs(const std::vector<ScanBoxes>& scans, const ClassGroup& group) {
  return std::any_of(scans.begin(), scans.end(), [&](const ScanBoxes& scan) {
    return std::any_of(scan.truths.begin(), scan.truths.end(),
                       [&](const TruthBox& truth) { return group.holds(truth.box.object_class); });
  });
}

std::size_t ignored_truths(const std::vector<ScanBoxes>& scans, const Window& window) {
  std::size_t ignored = 0;
  for (const ScanBoxes& scan : scans) {
    for (const TruthBox& truth : scan.truths) {
      const bool known = truth.box.object_class != maps::ObjectClass::kUnknown;
      ignored += known && window.counts(truth) ? 0 : 1;
    }
  }
  return ignored;
}

}  // namespace

double CentreRecall::by_track() const {
  if (tracks.empty()) return std::numeric_limits<double>::quiet_NaN();
  double sum = 0.0;
  for (const TrackRecall& track : tracks) sum += track.found.rate();
  return sum / static_cast<double>(tracks.size());
}

Window whole_window(double max_range_m) { return {.from_m = 0.0, .to_m = max_range_m}; }

BoxDetection box_figures(const std::vector<ScanBoxes>& scans, double max_range_m) {
  const Window window = whole_window(max_range_m);
  const CentreMatches vehicles(scans, kinds()[0], window, 0.0);
  BoxDetection out;
  out.ignored_truths = ignored_truths(scans, window);
  for (const ScanBoxes& scan : scans) out.boxes += scan.found.size();
  out.false_vehicles = vehicles.count(Verdict::kFalse);
  out.ignored_vehicles = vehicles.count(Verdict::kIgnored);
  out.false_boxes_per_scan = vehicles.false_per_scan();
  for (const ClassGroup& kind : kinds()) out.classes.push_back(class_figures(scans, kind, window));
  for (const ClassGroup& single : single_classes()) {
    if (occurs(scans, single)) out.classes.push_back(class_figures(scans, single, window));
  }
  for (int k = 0; k < kThresholds; ++k)
    out.thresholds.push_back(at_threshold(scans, window, static_cast<double>(k) / kThresholds));
  out.distances = by_distance(scans, vehicles, max_range_m);
  out.visibilities = by_visibility(scans, window);
  return out;
}

}  // namespace stillmap::mapping
