#pragma once

#include <stillmap/localization/thinning.hpp>

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::localization {

/// Where the aligner `default` looks for a scan, and with how much work. All defaults are those of
/// the preset `vehicle`, measured on simulated towns and highways and on KITTI, MulRan and HKU
/// (localization/honesty.md).
struct AlignerOptions {
  /// Around a prior without covariance, to each side [m], in [1, 30]. A covariance may make the
  /// search smaller or larger. A larger value finds worse priors; the time of a query grows with
  /// its square.
  double search_radius_m = 6.0;
  /// The same for the yaw [rad], in [0.05, pi]; the time grows in proportion.
  double search_yaw_rad = 0.40;
  /// How far up and down other storeys are tried [m], in [0, 30]. 0 if priors are always of the
  /// right storey.
  double search_height_m = 6.0;
  /// If nothing fits around a prior without covariance, the places that the map was driven at are
  /// tried up to this far from it [m], in [0, 200] (the default: two seconds of driving); 0 =
  /// never.
  double lost_radius_m = 30.0;
  /// The same for the yaw [rad], in [0.05, pi].
  double lost_yaw_rad = 1.0;
  /// How many starts around the prior are refined, in [1, 20]. More find more look-alike places;
  /// the time grows in proportion.
  int max_candidates = 3;
  /// The same for a search without a prior, or with a prior of large covariance, in [1, 50].
  int max_places = 5;
  /// Points nearer than this are taken for the vehicle itself, unless a quarter of the scan is
  /// that near [m], in [0, 20]: bonnet and tail of a car reach 2.5 m from a sensor on its roof.
  double own_vehicle_m = kOwnVehicleM;

  /// Every broken bound as "aligner.NAME: found VALUE, expected BOUNDS"; empty when usable.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// When an answer is `ok`, `degraded` or `lost`. Stricter values give fewer `ok`; looser ones give
/// `ok` where nobody has measured that it is right.
struct VerdictOptions {
  /// With fewer standing points where the map knows anything, the answer has
  /// `too_little_structure`, in [10, 1000].
  int min_standing_points = 60;
  /// Share of the standing points where the map must know anything, in [0, 1]; below it the answer
  /// has `little_overlap`.
  double min_known_share = 0.3;
  /// Share of the known standing points that must lie on the map's surfaces; below it the answer is
  /// `lost`, in [0, 1]. At wrong places of simulated streets 0.65 and less lie there, at the right
  /// one 0.95 and more, of real scans 0.83 and more.
  double lost_support = 0.35;
  /// The same for `ok`, in [0, 1]; below it the answer is `degraded` with `low_inlier_ratio`.
  double ok_support = 0.72;
  /// Share of the best place's support from which a second place makes the answer `ambiguous`, in
  /// [0.5, 1].
  double ambiguous_share = 0.9;
  /// Largest deviation of an `ok` pose along any axis [m], in [0.01, 10]; beyond it the answer has
  /// `large_covariance`.
  double max_ok_deviation_m = 0.15;
  /// The same for rotations [rad], in [0.001, 1].
  double max_ok_deviation_rad = 0.01;

  /// As for `AlignerOptions`, each as "verdict.NAME: ...".
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// How a session expects vehicles to move, and how long it trusts itself without the map.
struct TrackerOptions {
  /// Spectral density of the acceleration, in [1e-4, 1e4]: after t seconds of not being observed
  /// the velocity's deviation is sqrt(density t) [m^2/s^3]. 4 lets a car brake at once.
  double acceleration_density = 4.0;
  /// The same of the turning acceleration [rad^2/s^3], in [1e-6, 1e2].
  double turn_acceleration_density = 0.1;
  /// Deviation of an unknown velocity [m/s], in [0.01, 1000].
  double unknown_speed_m_s = 15.0;
  /// The same of the rate of turn [rad/s], in [0.001, 100].
  double unknown_turn_rad_s = 0.5;
  /// Poses are predicted without a match for so long [s], in [0, 60].
  double max_coast_s = 3.0;
  /// A scan is not looked for around a prediction whose deviation since the last match exceeds this
  /// [m], in [0.1, 100]; as far as the aligner looks around a prior.
  double max_drift_m = 6.0;
  /// After this many matches in a row that contradict the predicted motion, the session doubts the
  /// motion and not the matches, in [1, 1000].
  int max_contradictions = 5;
  /// Scans that are looked for widely around the prediction before the whole map is, in [0, 1000].
  int wide_searches = 3;
  /// Answers in a row that must agree with each other after a search, before one is `ok`, the first
  /// of them counted, in [1, 100].
  int agreeing_answers = 2;
  /// Answers and states are kept for so long behind the newest [s], in [0, 600].
  double history_s = 5.0;

  /// As for `AlignerOptions`, each as "tracker.NAME: ...".
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// All that is a choice in localization.
struct LocalizationOptions {
  AlignerOptions aligner;
  VerdictOptions verdict;
  TrackerOptions tracker;

  /// Of all three.
  [[nodiscard]] std::vector<std::string> violations() const;
};

/// `vehicle` (the default), `indoor` and `handheld`.
[[nodiscard]] std::span<const std::string_view> preset_names();
/// - `indoor`: a robot at walking speed in rooms and halls. Searches 3 m around a prior and never
///   another storey, and takes points from 0.6 m on.
/// - `handheld`: a person carries the sensor. Searches 0.8 rad around a prior, expects turns up to
///   2 rad/s and no speed of a car.
/// @throws std::invalid_argument naming the preset and the choices.
[[nodiscard]] LocalizationOptions preset(std::string_view name);

/// One option, for whoever reads or writes options as text.
struct OptionInfo {
  /// `aligner.search_radius_m`, as the field is called.
  std::string_view key;
  std::string_view unit;
  /// Both included.
  double least = 0.0;
  double most = 0.0;
  /// Whether it is a whole number.
  bool whole = false;
  double (*get)(const LocalizationOptions&) = nullptr;
  void (*set)(LocalizationOptions&, double) = nullptr;
};
[[nodiscard]] std::span<const OptionInfo> all_options();

}  // namespace stillmap::localization
