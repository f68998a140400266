#pragma once

#include "history.hpp"
#include "motion.hpp"
#include "session_state.hpp"

#include <stillmap/localization/tracker.hpp>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace stillmap::localization {

/// The state machine behind `Tracker`. What is given to it has been checked.
class TrackingSession {
 public:
  TrackingSession(std::shared_ptr<const Aligner> aligner, const TrackerOptions& options);
  [[nodiscard]] const Aligner& aligner() const { return *aligner_; }
  void initialize(const PosePdf& T_map_lidar);
  [[nodiscard]] TrackedPose track(std::int64_t stamp_ns, const ThinScan& scan_lidar,
                                  const std::optional<OdometryStep>& odometry);
  /// Nothing before the first scan was answered.
  [[nodiscard]] std::optional<std::int64_t> newest_ns() const { return history_.newest_ns(); }
  /// After a scan was answered.
  [[nodiscard]] TrackingState state() const;
  /// Of a session that is new.
  void restore(const TrackingState& state);
  [[nodiscard]] std::optional<Eigen::Isometry3d> believed_T_map_lidar() const;
  [[nodiscard]] bool knows_place_at(std::int64_t stamp_ns,
                                    const std::optional<OdometryStep>& odometry) const;
  void forget_place();
  /// The same: the other one was in another map.
  void continue_from(const TrackingSession& other, const Eigen::Isometry3d& T_map_other,
                     const Matrix6d& covariance);

 private:
  using Mode = TrackingMode;
  using Belief = TrackingBelief;
  /// One scan on its way to an answer.
  struct Step {
    std::int64_t stamp_ns = 0;
    std::optional<MotionState> predicted;
    SearchedFrom from = SearchedFrom::kEverywhere;
    AlignmentResult match;
    bool found = false;
    /// Found where the prediction admits it.
    bool agrees = false;
  };

  [[nodiscard]] TrackedPose answer_next(std::int64_t stamp_ns, const ThinScan& scan_lidar,
                                        const std::optional<OdometryStep>& odometry);
  [[nodiscard]] TrackedPose answer_late(std::int64_t stamp_ns, const ThinScan& scan_lidar) const;

  /// Counts scans that come too late; true when it is the newest stamp that was wrong.
  [[nodiscard]] bool is_of_another_clock(std::int64_t stamp_ns);
  void predict(Belief& belief, Step& step, const std::optional<OdometryStep>& odometry) const;
  void choose_mode(Belief& belief, const Step& step) const;
  [[nodiscard]] std::optional<Prior> prior_of(const Belief& belief, const Step& step) const;
  void match(Step& step, const ThinScan& scan_lidar, const std::optional<Prior>& prior) const;

  /// The pose to go on from after a match that agrees with the prediction.
  [[nodiscard]] static PosePdf believed(const Step& step);
  [[nodiscard]] AlignmentResult follow(Belief& belief, const Step& step) const;
  [[nodiscard]] AlignmentResult coast(Belief& belief, const Step& step) const;
  [[nodiscard]] AlignmentResult search(Belief& belief, const Step& step) const;

  [[nodiscard]] bool is_confirmed(const Belief& belief) const {
    return belief.agreed >= options_.agreeing_answers;
  }

  std::shared_ptr<const Aligner> aligner_;
  TrackerOptions options_;
  MotionModel model_;
  std::optional<PosePdf> given_;
  Belief belief_;
  TrackingHistory history_;
  /// In a row, each newer than the one before: scans older than what is kept.
  int too_old_ = 0;
  std::int64_t too_old_ns_ = 0;
};

}  // namespace stillmap::localization
