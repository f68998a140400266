#include "ground/ground_under.hpp"

#include "ground/ground_sheets.hpp"
#include "ground/kerb_run.hpp"
#include "ground/step_fit.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

/// Ground up to this far around a footprint is looked at [m]: a car length ahead and behind, where
/// kerbs are seen between parked cars.
constexpr double kAroundM = 3.0;
/// Cells this far outside are laid too [m]: boxes are not exact.
constexpr double kMarginM = 0.5;
/// Ground this far outside is suspect too [m].
constexpr double kSuspectMarginM = 0.1;
/// A suspect this near to the planes is ground [m].
constexpr double kSuspectM = 0.04;
/// A measured cell farther from the planes than this does not pull the membrane [m]: it belongs to
/// something else, or to the other side.
constexpr double kPullM = 0.06;
constexpr int kSweeps = 60;
/// How much the planes hold the membrane, against one neighbour.
constexpr double kHold = 0.02;

/// The cells in and around one footprint.
class Window {
 public:
  Window(MeasuredSheets& ground, const GroundFootprint& footprint)
      : ground_(ground), footprint_(footprint) {
    const Eigen::Vector2d reach = footprint.reach(kAroundM);
    const Eigen::Vector2d low = footprint.centre.head<2>() - reach;
    const Eigen::Vector2d high = footprint.centre.head<2>() + reach;
    x0_ = ground_cell_of(low.x());
    y0_ = ground_cell_of(low.y());
    columns_ = ground_cell_of(high.x()) - x0_ + 1;
    rows_ = ground_cell_of(high.y()) - y0_ + 1;
    cells_.resize(static_cast<std::size_t>(columns_ * rows_));
    for (int y = 0; y < rows_; ++y) {
      for (int x = 0; x < columns_; ++x) look_at(x, y);
    }
  }

  void lay(const SteppedPlane& planes) {
    take_sides(planes);
    relax();
    write(planes);
  }

  [[nodiscard]] FittedFootprint fit() const {
    FittedFootprint fitted;
    Eigen::Vector2d slope = Eigen::Vector2d::Zero();
    for (const Cell& cell : cells_) {
      if (!cell.in_window) continue;
      const GroundNode& node = ground_.sheets.node(cell.place);
      if (node.state != GroundState::kKnown) continue;
      // What is near says more about what lies below.
      const double away = (cell.p.cwiseAbs() - footprint_.half_m).cwiseMax(0.0).norm();
      const double weight = static_cast<double>(node.confidence_255) / 255.0 / (1.0 + away * away);
      fitted.samples.push_back({cell.p, static_cast<double>(node.z), weight});
      slope += ground_.slopes[cell.place.sheet].cast<double>();
    }
    if (fitted.samples.empty()) return fitted;
    slope /= static_cast<double>(fitted.samples.size());
    const Eigen::Vector2d h = footprint_.heading;
    fitted.planes = fit_stepped_plane(
        fitted.samples,
        {footprint_.half_m.array() + 0.25, {h.dot(slope), h.x() * slope.y() - h.y() * slope.x()}});
    return fitted;
  }

 private:
  struct Cell {
    GroundSheets::Place place;
    /// In the footprint's own frame [m].
    Eigen::Vector2d p = Eigen::Vector2d::Zero();
    bool in_window = false;
    /// To be laid.
    bool open = false;
    /// Pulls the membrane: measured, and on these planes.
    bool fixed = false;
    int side = 0;
    /// Height over the planes [m].
    double rest = 0.0;
  };

  void look_at(int x, int y) {
    const int cell_x = x0_ + x;
    const int cell_y = y0_ + y;
    Cell& cell = cells_[static_cast<std::size_t>(y * columns_ + x)];
    cell.p = footprint_.inside({ground_cell_centre(cell_x), ground_cell_centre(cell_y)});
    const Eigen::Vector2d out = cell.p.cwiseAbs() - footprint_.half_m;
    if ((out.array() > kAroundM).any()) return;
    const auto place = ground_.sheets.find(cell_x, cell_y, footprint_.centre.z());
    if (!place) return;
    cell.place = *place;
    cell.in_window = true;
    const bool known = ground_.sheets.node(*place).state == GroundState::kKnown;
    cell.open = !known && (out.array() <= kMarginM).all();
  }

  void take_sides(const SteppedPlane& planes) {
    for (Cell& cell : cells_) {
      if (!cell.in_window) continue;
      cell.side = planes.side_of(cell.p);
      GroundNode& node = ground_.sheets.node(cell.place);
      const double plane_z = planes.z_at(cell.p, cell.side);
      if (cell.open) accept(cell, node, plane_z);
      if (node.state != GroundState::kKnown) continue;
      cell.rest = static_cast<double>(node.z) - plane_z;
      cell.fixed = std::abs(cell.rest) <= kPullM;
    }
  }

  /// Makes a suspect ground when it lies on the planes.
  void accept(Cell& cell, GroundNode& node, double plane_z) const {
    if (cell.place.sheet >= ground_.measured()) return;
    const GroundCellSum& sum =
        ground_.pile(cell.place.sheet).cells[static_cast<std::size_t>(cell.place.node)];
    if (sum.weight <= 0.0F || std::abs(static_cast<double>(sum.z) - plane_z) > kSuspectM) return;
    node.z = sum.z;
    node.state = GroundState::kKnown;
    node.reach = 0;
    cell.open = false;
  }

  void relax() {
    for (int sweep = 0; sweep < kSweeps; ++sweep) {
      for (int y = 1; y + 1 < rows_; ++y) {
        for (int x = 1; x + 1 < columns_; ++x) relax(y * columns_ + x);
      }
    }
  }

  void relax(int k) {
    Cell& cell = cells_[static_cast<std::size_t>(k)];
    if (!cell.open) return;
    double sum = 0.0;
    double weight = kHold;
    for (const int step : {-1, 1, -columns_, columns_}) {
      const Cell& other = cells_[static_cast<std::size_t>(k + step)];
      if (other.side != cell.side || !(other.open || other.fixed)) continue;
      sum += other.rest;
      weight += 1.0;
    }
    cell.rest = sum / weight;
  }

  /// A cell that the step crosses gets a height between: half of it would be wrong by all of the
  /// step otherwise.
  [[nodiscard]] static double mixed_z(const SteppedPlane& planes, const Eigen::Vector2d& p) {
    if (!planes.has_step) return planes.z_at(p);
    const double beyond = planes.normal.dot(p) - planes.offset;
    const double share = std::clamp(0.5 + beyond / kGroundCellM, 0.0, 1.0);
    return share * planes.z_at(p, 1) + (1.0 - share) * planes.z_at(p, 0);
  }

  void write(const SteppedPlane& planes) {
    const Eigen::Vector2d h = footprint_.heading;
    for (const Cell& cell : cells_) {
      if (!cell.open) continue;
      GroundNode& node = ground_.sheets.node(cell.place);
      const Eigen::Vector3d& plane = planes.planes[static_cast<std::size_t>(cell.side)];
      node.z = static_cast<float>(mixed_z(planes, cell.p) + cell.rest);
      node.slope_x = static_cast<float>(h.x() * plane[1] - h.y() * plane[2]);
      node.slope_y = static_cast<float>(h.y() * plane[1] + h.x() * plane[2]);
    }
  }

  MeasuredSheets& ground_;
  const GroundFootprint& footprint_;
  int x0_ = 0, y0_ = 0, columns_ = 0, rows_ = 0;
  std::vector<Cell> cells_;
};

}  // namespace

void suspect_ground_under(MeasuredSheets& ground, std::span<const GroundFootprint> footprints) {
  for (const GroundFootprint& footprint : footprints) {
    const Eigen::Vector2d reach = footprint.reach(kSuspectMarginM);
    const Eigen::Vector2d low = footprint.centre.head<2>() - reach;
    const Eigen::Vector2d high = footprint.centre.head<2>() + reach;
    for (int y = ground_cell_of(low.y()); y <= ground_cell_of(high.y()); ++y) {
      for (int x = ground_cell_of(low.x()); x <= ground_cell_of(high.x()); ++x) {
        if (!footprint.covers({ground_cell_centre(x), ground_cell_centre(y)}, kSuspectMarginM))
          continue;
        const auto place = ground.sheets.find(x, y, footprint.centre.z());
        if (!place) continue;
        GroundNode& node = ground.sheets.node(*place);
        if (node.state == GroundState::kKnown) node.state = GroundState::kSuspect;
      }
    }
  }
}

void lay_ground_under(MeasuredSheets& ground, std::span<const GroundFootprint> footprints) {
  // All are fitted before any is laid, so that their order does not count.
  std::vector<FittedFootprint> fitted;
  fitted.reserve(footprints.size());
  for (const GroundFootprint& footprint : footprints) {
    fitted.push_back(Window(ground, footprint).fit());
    ground.stepped(fitted.size());
  }
  continue_kerbs(footprints, fitted);
  for (std::size_t i = 0; i < footprints.size(); ++i) {
    if (fitted[i].planes) Window(ground, footprints[i]).lay(*fitted[i].planes);
    ground.stepped(i);
  }
}

}  // namespace stillmap::mapping
