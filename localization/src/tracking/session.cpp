#include "session.hpp"

#include "align/registration.hpp"

#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap::localization {
namespace {

/// Deviations of a wide search; three of them are as far as the aligner looks around a prior.
constexpr double kWideM = 2.0;
constexpr double kWideRad = 0.13;
/// A wide search covers a prediction up to so many times `max_drift_m`, and one beyond so many
/// agrees with too much to confirm anything.
constexpr double kWideShare = 1.5;
constexpr double kVagueShare = 5.0;
/// Places that look alike lie at least so far from each other [m], their headings [rad].
constexpr double kApartM = 0.5;
constexpr double kApartRad = 0.2;
constexpr double kSmallTurnRad = 0.5;
/// Deviation of what a scan tells along a direction that it does not constrain [m].
constexpr double kNothingM = 1e3;
/// Deviations up to which a velocity is known: within a sweep they move points by some centimetres.
constexpr double kKnownSpeedM_S = 2.0;
constexpr double kKnownTurnRad_S = 0.2;
/// So many scans in a row, each newer than the one before and all older than what is kept, are
/// right about the time, and it was the newest that was not.
constexpr int kScansOfAnotherClock = 5;

void add_reason(AlignmentResult& result, Reason reason) {
  if (std::find(result.reasons.begin(), result.reasons.end(), reason) == result.reasons.end()) {
    result.reasons.push_back(reason);
  }
}

/// Takes `ok` and its protection back.
void demote(AlignmentResult& result, PoseStatus status, Reason reason) {
  result.status = status;
  result.protection = {};
  add_reason(result, reason);
}

/// The prediction in place of a match; the other fields still tell how the match went.
AlignmentResult in_place_of(const AlignmentResult& match, const MotionState& predicted,
                            Reason reason) {
  AlignmentResult result = match;
  demote(result, PoseStatus::kDegraded, reason);
  result.T_map_lidar = predicted.pose.T;
  result.covariance = predicted.pose.covariance;
  return result;
}

bool is_ambiguous(const AlignmentResult& match) {
  return std::find(match.reasons.begin(), match.reasons.end(), Reason::kAmbiguous) !=
         match.reasons.end();
}

/// A prediction that knows no attitude and is turned far from the match, with the match's rotation:
/// what is said to first order about poses holds for small turns alone.
PosePdf turned_to(const PosePdf& matched, const PosePdf& predicted) {
  const double most = predicted.covariance.diagonal().tail<3>().maxCoeff();
  if (most <= kSmallTurnRad * kSmallTurnRad) return predicted;
  const Eigen::Matrix3d R = matched.T.linear().transpose() * predicted.T.linear();
  if (Eigen::AngleAxisd(R).angle() <= kSmallTurnRad) return predicted;
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R;
  PosePdf turned{predicted.T, turn * predicted.covariance * turn.transpose()};
  turned.T.linear() = matched.T.linear();
  return turned;
}

/// Whether scans are deskewed better by the predicted velocity than by what one scan tells of it.
bool knows_velocity(const MotionState& state) {
  const Matrix6d& covariance = state.twist_covariance;
  return covariance.diagonal().head<3>().maxCoeff() < kKnownSpeedM_S * kKnownSpeedM_S &&
         covariance.diagonal().tail<3>().maxCoeff() < kKnownTurnRad_S * kKnownTurnRad_S;
}

/// Whether a second place that looks alike may lie within three deviations of a pose.
bool admits_another_place(const PosePdf& pose) {
  return 3.0 * std::sqrt(pose.covariance.diagonal().head<3>().maxCoeff()) > kApartM ||
         3.0 * std::sqrt(pose.covariance.diagonal().tail<3>().maxCoeff()) > kApartRad;
}

}  // namespace

TrackingSession::TrackingSession(std::shared_ptr<const Aligner> aligner,
                                 const TrackerOptions& options)
    : aligner_(std::move(aligner)),
      options_(options),
      model_(options),
      history_(options.history_s) {}

void TrackingSession::initialize(const PosePdf& T_map_lidar) {
  given_ = T_map_lidar;
  belief_ = {};
  history_ = TrackingHistory(options_.history_s);
}

TrackingState TrackingSession::state() const {
  TrackingState state{.newest_ns = history_.newest_ns().value(), .belief = belief_, .newest = {}};
  if (const auto* known = history_.state_at(state.newest_ns)) state.newest = *known;
  return state;
}

void TrackingSession::restore(const TrackingState& state) {
  belief_ = state.belief;
  history_.restore(state.newest_ns, state.newest);
}

std::optional<Eigen::Isometry3d> TrackingSession::believed_T_map_lidar() const {
  if (given_) return given_->T;
  if (belief_.anchor) return belief_.anchor->pose.T;
  return std::nullopt;
}

bool TrackingSession::knows_place_at(std::int64_t stamp_ns,
                                     const std::optional<OdometryStep>& odometry) const {
  if (history_.newest_ns() && stamp_ns <= *history_.newest_ns()) return true;
  Belief belief = belief_;
  Step step;
  step.stamp_ns = stamp_ns;
  predict(belief, step, odometry);
  choose_mode(belief, step);
  return belief.mode == Mode::kTracking;
}

void TrackingSession::forget_place() {
  given_.reset();
  belief_ = {};
  history_.forget_states();
}

void TrackingSession::continue_from(const TrackingSession& other,
                                    const Eigen::Isometry3d& T_map_other,
                                    const Matrix6d& covariance) {
  // Perturbations are on the right, in the lidar frame: covariances and velocities stay as they
  // are.
  const auto move = [&](PosePdf& pose) {
    pose.T = T_map_other * pose.T;
    pose.covariance += covariance;
  };
  given_ = other.given_;
  if (given_) move(*given_);
  belief_ = other.belief_;
  if (belief_.anchor) move(belief_.anchor->pose);
  history_.continue_from(other.history_, move);
  too_old_ = other.too_old_;
  too_old_ns_ = other.too_old_ns_;
}

TrackedPose TrackingSession::track(std::int64_t stamp_ns, const ThinScan& scan_lidar,
                                   const std::optional<OdometryStep>& odometry) {
  if (const TrackedPose* known = history_.answer_at(stamp_ns)) return *known;
  if (is_of_another_clock(stamp_ns)) {
    // On a copy: the aligner may throw.
    TrackingSession anew(aligner_, options_);
    TrackedPose answer = anew.answer_next(stamp_ns, scan_lidar, odometry);
    add_reason(answer.result, Reason::kClockSetBack);
    anew.history_.add(answer);
    *this = std::move(anew);
    return answer;
  }
  const auto newest_ns = history_.newest_ns();
  TrackedPose answer = newest_ns && stamp_ns <= *newest_ns
                           ? answer_late(stamp_ns, scan_lidar)
                           : answer_next(stamp_ns, scan_lidar, odometry);
  history_.add(answer);
  return answer;
}

bool TrackingSession::is_of_another_clock(std::int64_t stamp_ns) {
  if (!history_.newest_ns() || history_.keeps(stamp_ns)) {
    too_old_ = 0;
    return false;
  }
  too_old_ = too_old_ > 0 && stamp_ns > too_old_ns_ ? too_old_ + 1 : 1;
  too_old_ns_ = stamp_ns;
  return too_old_ >= kScansOfAnotherClock;
}

TrackedPose TrackingSession::answer_next(std::int64_t stamp_ns, const ThinScan& scan_lidar,
                                         const std::optional<OdometryStep>& odometry) {
  // Changed on a copy: the aligner may throw.
  Belief belief = belief_;
  Step step;
  step.stamp_ns = stamp_ns;
  predict(belief, step, odometry);
  choose_mode(belief, step);
  if (!belief.anchor) step.predicted.reset();
  const std::optional<Prior> prior = prior_of(belief, step);
  if (!prior) step.from = SearchedFrom::kEverywhere;
  match(step, scan_lidar, prior);

  const bool tracking = belief.mode == Mode::kTracking;
  const AlignmentResult result = tracking ? follow(belief, step) : search(belief, step);
  // Between the poses before a search and those after it there is no way to interpolate along.
  if (!tracking && belief.agreed <= 1) history_.forget_states();
  if (tracking && belief.anchor->stamp_ns < stamp_ns) {
    history_.add({*step.predicted, belief.matched});
  } else if (belief.anchor && belief.anchor->stamp_ns == stamp_ns) {
    history_.add({*belief.anchor, belief.matched && is_confirmed(belief)});
  }
  belief_ = belief;
  given_.reset();
  return {stamp_ns, result, step.from};
}

void TrackingSession::predict(Belief& belief, Step& step,
                              const std::optional<OdometryStep>& odometry) const {
  if (given_) {
    belief.anchor = model_.at_unknown_velocity(step.stamp_ns, *given_);
    belief.mode = Mode::kTracking;
    belief.matched_ns = step.stamp_ns;
    belief.agreed = options_.agreeing_answers;
    step.predicted = belief.anchor;
    step.from = SearchedFrom::kGiven;
    return;
  }
  if (!belief.anchor) return;
  const TrackingHistory::Known* since = odometry ? history_.state_at(odometry->since_ns) : nullptr;
  step.from = since != nullptr ? SearchedFrom::kOdometry : SearchedFrom::kVelocity;
  step.predicted = since != nullptr ? model_.predicted(since->state, step.stamp_ns, *odometry)
                                    : model_.predicted(*belief.anchor, step.stamp_ns);
}

void TrackingSession::choose_mode(Belief& belief, const Step& step) const {
  if (!belief.anchor) {
    belief.mode = Mode::kEverywhere;
    return;
  }
  if (belief.mode == Mode::kTracking && step.from != SearchedFrom::kGiven) {
    const bool astray = !(step.predicted->drift_m <= options_.max_drift_m);
    if (belief.contradictions >= options_.max_contradictions ||
        maps::seconds_between(belief.matched_ns, step.stamp_ns) > options_.max_coast_s ||
        (astray && belief.misses > 0)) {
      belief.mode = Mode::kWide;
      belief.agreed = 0;
      belief.misses = 0;
    } else if (astray) {
      // The last scan was found and only too long ago: a place that agrees with it is believed.
      belief.mode = Mode::kEverywhere;
    }
  }
  if (belief.mode == Mode::kTracking) return;
  const bool far = !(step.predicted->drift_m <= kWideShare * options_.max_drift_m);
  const bool in_vain = belief.misses >= std::max(1, options_.wide_searches);
  if (belief.mode == Mode::kWide && (far || in_vain || options_.wide_searches == 0)) {
    belief.mode = Mode::kEverywhere;
  }
  // What was found before and not confirmed stays to be agreed with; what was lost does not.
  if (belief.mode == Mode::kEverywhere && (belief.agreed == 0 || in_vain)) {
    belief.anchor.reset();
    belief.agreed = 0;
  }
}

std::optional<Prior> TrackingSession::prior_of(const Belief& belief, const Step& step) const {
  if (belief.mode == Mode::kEverywhere) return std::nullopt;
  Prior prior{step.predicted->pose.T, step.predicted->pose.covariance};
  if (belief.mode == Mode::kWide) {
    prior.covariance->diagonal().head<3>().array() += kWideM * kWideM;
    prior.covariance->diagonal().tail<3>().array() += kWideRad * kWideRad;
  }
  return prior;
}

void TrackingSession::match(Step& step, const ThinScan& scan_lidar,
                            const std::optional<Prior>& prior) const {
  // Where nothing has told the velocity, the aligner finds it.
  if (step.predicted && knows_velocity(*step.predicted) &&
      !scan_lidar.points_lidar.time_offsets_s.empty()) {
    ThinScan at_stamp = scan_lidar;
    maps::deskew(at_stamp.points_lidar, step.predicted->twist);
    step.match = aligner_->align_thin(at_stamp, prior);
  } else {
    step.match = aligner_->align_thin(scan_lidar, prior);
  }
  step.found = step.match.status != PoseStatus::kLost;
  const bool against = std::erase(step.match.reasons, Reason::kContradictsPrior) > 0;
  step.agrees = step.found && !against && step.predicted &&
                step.predicted->drift_m <= kVagueShare * options_.max_drift_m &&
                chi_squared(step.predicted->pose, {step.match.T_map_lidar, step.match.covariance}) <
                    kMaxChiSquared;
}

PosePdf TrackingSession::believed(const Step& step) {
  PosePdf matched{step.match.T_map_lidar, step.match.covariance};
  // Where a scan tells nothing, many of them do not tell more.
  for (Vector6d direction : step.match.degenerate_directions) {
    direction.tail<3>() /= kLeverM;
    matched.covariance += kNothingM * kNothingM * direction * direction.transpose();
  }
  // A weak match is no reason to forget what the motion tells about the directions it leaves open.
  if (step.match.status == PoseStatus::kOk) return matched;
  return fused(turned_to(matched, step.predicted->pose), matched);
}

AlignmentResult TrackingSession::follow(Belief& belief, const Step& step) const {
  if (!step.agrees) return coast(belief, step);
  belief.matched_ns = step.stamp_ns;
  belief.misses = 0;
  belief.contradictions = 0;
  if (is_ambiguous(step.match) && admits_another_place(step.predicted->pose)) {
    // Later scans tell which place it is, as long as all that look alike stay in reach.
    if (step.from == SearchedFrom::kOdometry) belief.anchor = step.predicted;
    return step.match;
  }
  // The way from a pose that was only given to the first match is no motion.
  belief.anchor = belief.matched ? model_.moved_to(*belief.anchor, step.stamp_ns, believed(step))
                                 : model_.at_unknown_velocity(step.stamp_ns, believed(step));
  if (!step.match.degenerate_directions.empty())
    belief.anchor->odometry_steps = step.predicted->odometry_steps;
  belief.matched = true;
  return step.match;
}

AlignmentResult TrackingSession::coast(Belief& belief, const Step& step) const {
  if (step.from == SearchedFrom::kOdometry) belief.anchor = step.predicted;
  ++belief.misses;
  AlignmentResult result = step.match;
  if (step.found) {
    ++belief.contradictions;
    add_reason(result, Reason::kContradictsMotion);
  }
  if (belief.matched) return in_place_of(result, *step.predicted, Reason::kCoasting);
  // A pose that was given and that no scan has agreed with is the caller's own, no answer.
  demote(result, PoseStatus::kLost, Reason::kNotTracked);
  return result;
}

AlignmentResult TrackingSession::search(Belief& belief, const Step& step) const {
  AlignmentResult result = step.match;
  if (!step.found || is_ambiguous(step.match)) {
    ++belief.misses;
    demote(result, step.match.status, step.found ? Reason::kUnconfirmed : Reason::kNotTracked);
    return result;
  }
  const bool again = belief.agreed > 0;
  if (again && step.agrees) {
    belief.anchor = model_.moved_to(*belief.anchor, step.stamp_ns, believed(step));
    ++belief.agreed;
  } else {
    belief.anchor =
        model_.at_unknown_velocity(step.stamp_ns, {step.match.T_map_lidar, step.match.covariance});
    belief.agreed = 1;
    if (step.predicted && !step.agrees) add_reason(result, Reason::kContradictsMotion);
  }
  belief.matched_ns = step.stamp_ns;
  belief.matched = true;
  belief.misses = 0;
  belief.contradictions = 0;
  if (!is_confirmed(belief)) {
    demote(result, PoseStatus::kDegraded, Reason::kUnconfirmed);
  } else {
    belief.mode = Mode::kTracking;
  }
  return result;
}

TrackedPose TrackingSession::answer_late(std::int64_t stamp_ns, const ThinScan& scan_lidar) const {
  Step step;
  step.stamp_ns = stamp_ns;
  step.from = SearchedFrom::kNowhere;
  const auto around = history_.keeps(stamp_ns) ? history_.around(stamp_ns) : std::nullopt;
  if (!around) {
    demote(step.match, PoseStatus::kLost, Reason::kTooOld);
    return {stamp_ns, step.match, step.from};
  }
  const auto& [before, after] = *around;
  step.predicted = after != nullptr ? model_.interpolated(before->state, after->state, stamp_ns)
                                    : model_.predicted(before->state, stamp_ns);
  if (!(step.predicted->drift_m <= options_.max_drift_m)) {
    demote(step.match, PoseStatus::kLost, Reason::kNotTracked);
    return {stamp_ns, step.match, step.from};
  }
  step.from = SearchedFrom::kInterpolation;
  match(step, scan_lidar, Prior{step.predicted->pose.T, step.predicted->pose.covariance});
  AlignmentResult result = step.match;
  if (step.found && !step.agrees) add_reason(result, Reason::kContradictsMotion);
  if (!step.agrees) result = in_place_of(result, *step.predicted, Reason::kInterpolated);
  if (!before->confirmed || (after != nullptr && !after->confirmed)) {
    demote(result, step.agrees ? PoseStatus::kDegraded : PoseStatus::kLost, Reason::kUnconfirmed);
  }
  return {stamp_ns, result, step.from};
}

}  // namespace stillmap::localization
