#include "loops/loop_finder.hpp"

#include "core/ordered_pipeline.hpp"
#include "loops/keyframe_store.hpp"
#include "loops/loop_check.hpp"
#include "loops/odometry_path.hpp"
#include "loops/proposals.hpp"
#include "loops/submaps.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Keyframes so far apart along the path are looked at [m]: a loop every few metres is enough.
constexpr double kQuerySpacingM = 2.0;
/// Alignments tried for one of them at most.
constexpr std::size_t kMostTries = 3;
constexpr int kMostRounds = 8;

/// A keyframe that a loop is looked for from.
struct Query {
  std::size_t keyframe = 0;
  std::vector<Proposal> alike;
  /// Submaps it was compared with.
  std::vector<std::size_t> tried;
};

std::vector<std::size_t> queries_along(const OdometryPath& path) {
  std::vector<std::size_t> out;
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (out.empty() || path.way_m(out.back(), i) >= kQuerySpacingM) out.push_back(i);
  }
  return out;
}

/// One run over all keyframes.
class Search {
 public:
  Search(const KeyframeStore& keyframes, const OdometryPath& path, int threads,
         const ProgressCallback& progress, const CancelFlag& cancel,
         const std::optional<GivenPlaces>& given)
      : path_(path),
        submaps_(keyframes, path),
        threads_(threads),
        progress_(progress),
        cancel_(cancel),
        given_(given) {}

  [[nodiscard]] std::vector<Loop> run() {
    look_for_alike();
    for (int round = 0; round < kMostRounds; ++round) {
      const std::map<std::size_t, std::vector<Proposal>> work = next_tries();
      if (work.empty()) break;
      check(work);
    }
    std::vector<Loop> loops = believed();
    std::stable_sort(loops.begin(), loops.end(),
                     [](const Loop& a, const Loop& b) { return a.to < b.to; });
    return loops;
  }

 private:
  void look_for_alike() {
    std::vector<ScanContext> contexts;
    contexts.reserve(path_.size());
    process_in_order(
        path_.size(), threads_,
        [&](std::size_t i) {
          std::vector<Eigen::Vector3f> view = submaps_.view_from(i);
          const Eigen::Matrix3f R = R_level_lidar(path_.T_odom_lidar(i)).cast<float>();
          for (Eigen::Vector3f& p : view) p = R * p;
          return describe(view);
        },
        [&](const ScanContext& context) {
          contexts.push_back(context);
          if (progress_) progress_("describe places", contexts.size(), path_.size());
        },
        cancel_);
    const ContextProposals proposals(contexts, path_);
    const std::vector<std::size_t> keyframes = queries_along(path_);
    process_in_order(
        keyframes.size(), threads_, [&](std::size_t i) { return proposals.of(keyframes[i]); },
        [&](std::vector<Proposal>&& alike) {
          queries_.push_back({keyframes[queries_.size()], std::move(alike), {}});
        },
        cancel_);
  }

  [[nodiscard]] std::vector<Loop> believed() const {
    const std::vector<char> agreed = agreed_loops(found_, path_);
    std::vector<Loop> out;
    for (std::size_t i = 0; i < found_.size(); ++i) {
      if (agreed[i] != 0) out.push_back(found_[i]);
    }
    return out;
  }

  /// What each query without a loop is compared with next, by submap, so that each is made once.
  [[nodiscard]] std::map<std::size_t, std::vector<Proposal>> next_tries() {
    const std::vector<Loop> loops = believed();
    const PathProposals known(path_, submaps_, loops, given_);
    std::set<std::size_t> done;
    for (const Loop& loop : loops) done.insert(loop.to);
    std::map<std::size_t, std::vector<Proposal>> work;
    for (Query& query : queries_) {
      if (done.count(query.keyframe) != 0 || query.tried.size() == kMostTries) continue;
      const std::optional<Proposal> next = next_try(query, known);
      if (!next) continue;
      const std::size_t submap = submaps_.around(next->place);
      query.tried.push_back(submap);
      work[submap].push_back(*next);
    }
    return work;
  }

  [[nodiscard]] std::optional<Proposal> next_try(const Query& query,
                                                 const PathProposals& known) const {
    const auto is_new = [&](const Proposal& proposal) {
      const std::size_t submap = submaps_.around(proposal.place);
      return std::find(query.tried.begin(), query.tried.end(), submap) == query.tried.end();
    };
    std::optional<Proposal> by_path = known.of(query.keyframe);
    if (by_path && is_new(*by_path)) return by_path;
    for (const Proposal& proposal : query.alike) {
      if (is_new(proposal) && known.plausible(query.keyframe, proposal.place)) return proposal;
    }
    return std::nullopt;
  }

  void check(const std::map<std::size_t, std::vector<Proposal>>& work) {
    const std::vector<std::pair<std::size_t, std::vector<Proposal>>> jobs(work.begin(), work.end());
    std::size_t done = 0;
    process_in_order(
        jobs.size(), threads_,
        [&](std::size_t i) {
          const Submap submap = submaps_.load(jobs[i].first);
          std::vector<Loop> loops;
          for (const Proposal& proposal : jobs[i].second) {
            const std::vector<Eigen::Vector3f> view = submaps_.view_from(proposal.query);
            if (const auto loop = check_loop(proposal, view, submap, path_)) loops.push_back(*loop);
          }
          return loops;
        },
        [&](const std::vector<Loop>& loops) {
          found_.insert(found_.end(), loops.begin(), loops.end());
          if (progress_) progress_("check loops", ++done, jobs.size());
        },
        cancel_);
  }

  const OdometryPath& path_;
  Submaps submaps_;
  int threads_;
  const ProgressCallback& progress_;
  const CancelFlag& cancel_;
  const std::optional<GivenPlaces>& given_;
  std::vector<Query> queries_;
  std::vector<Loop> found_;
};

}  // namespace

struct LoopFinder::State {
  explicit State(const std::filesystem::path& scratch) : keyframes(scratch) {}

  KeyframeStore keyframes;
  OdometryPath path;
};

LoopFinder::LoopFinder(const std::filesystem::path& scratch)
    : state_(std::make_unique<State>(scratch)) {}

LoopFinder::~LoopFinder() = default;

void LoopFinder::add(const LoopKeyframe& keyframe) {
  if (!keyframe.T_odom_lidar.matrix().allFinite() || !keyframe.covariance.allFinite())
    throw std::invalid_argument("keyframe: its pose or covariance is not finite");
  const OdometryPath& path = state_->path;
  if (path.size() > 0 && keyframe.drive < path.drive(path.size() - 1))
    throw std::invalid_argument("keyframe: of a drive before the last one");
  state_->keyframes.append(keyframe.points);
  state_->path.append(keyframe.T_odom_lidar, keyframe.covariance, keyframe.drive);
}

std::vector<Loop> LoopFinder::find(int threads, const ProgressCallback& progress,
                                   const CancelFlag& cancel,
                                   const std::optional<GivenPlaces>& given) {
  if (given && given->T_map_lidar.size() != state_->path.size())
    throw std::invalid_argument("given places: expected one a keyframe");
  return Search(state_->keyframes, state_->path, threads, progress, cancel, given).run();
}

}  // namespace stillmap::mapping
