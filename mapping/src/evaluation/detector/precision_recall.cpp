#include "evaluation/detector/precision_recall.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr int kRecalls = 40;

/// Boxes that were judged true or false, by falling score.
struct Judged {
  double score = 0.0;
  bool is_true = false;
};

std::vector<PrecisionRecall> curve_of(std::vector<Judged> judged, std::size_t truths) {
  std::sort(judged.begin(), judged.end(),
            [](const Judged& a, const Judged& b) { return a.score > b.score; });
  std::vector<PrecisionRecall> curve;
  std::size_t is_true = 0;
  for (std::size_t i = 0; i < judged.size(); ++i) {
    is_true += judged[i].is_true ? 1 : 0;
    // Boxes of one score are kept or dropped together.
    if (i + 1 < judged.size() && judged[i + 1].score == judged[i].score) continue;
    curve.push_back({judged[i].score, Share{is_true, i + 1}.rate(), Share{is_true, truths}.rate()});
  }
  return curve;
}

}  // namespace

AveragePrecision average_precision(const std::vector<ScanBoxes>& scans, const ClassGroup& group,
                                   const Window& window, double iou) {
  AveragePrecision out;
  out.iou = iou;
  std::size_t truths = 0;
  std::vector<Judged> judged;
  for (const ScanBoxes& scan : scans) {
    const ScanMatch match = match_by_overlap(scan, group, window, iou);
    truths += static_cast<std::size_t>(std::count(match.counts.begin(), match.counts.end(), 1));
    for (std::size_t i = 0; i < scan.found.size(); ++i) {
      const Verdict verdict = match.verdicts[i];
      if (verdict == Verdict::kTrue || verdict == Verdict::kFalse)
        judged.push_back({scan.found[i].score, verdict == Verdict::kTrue});
    }
  }
  out.value = std::numeric_limits<double>::quiet_NaN();
  if (truths == 0) return out;
  out.curve = curve_of(std::move(judged), truths);
  out.value = mean_of_40_recalls(out.curve);
  return out;
}

double mean_of_40_recalls(const std::vector<PrecisionRecall>& curve) {
  // A recall of k / n is met by k / n although neither is exact.
  constexpr double kRounding = 1e-9;
  double sum = 0.0;
  double best = 0.0;
  auto place = curve.rbegin();
  for (int k = kRecalls; k >= 1; --k) {
    const double recall = static_cast<double>(k) / kRecalls;
    for (; place != curve.rend() && place->recall >= recall - kRounding; ++place)
      best = std::max(best, place->precision);
    sum += best;
  }
  return sum / kRecalls;
}

}  // namespace stillmap::mapping
