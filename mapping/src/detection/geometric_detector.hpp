#pragma once

#include <stillmap/mapping/detector.hpp>

namespace stillmap::mapping {

/// Objects by their shape alone, without a network.
///
/// Points above the ground fall into a grid of columns. Columns that reach through head height
/// belong to walls, trunks and poles and part the rest into clusters; each gets the upright
/// rectangle that its outline fits best (closeness criterion of Zhang, Xu, Dong, Dolan, "Efficient
/// L-Shape Fitting for Vehicle Detection Using Laser Scanners", IV 2017), and is an object when
/// size, height over ground and fit are those of a car, a van or truck, or a person. The side that
/// the sensor cannot see is completed to the usual size unless a wall stands there.
///
/// It takes hedges and bins of such sizes for objects, and misses cars that touch a wall.
class GeometricDetector final : public Detector {
 public:
  [[nodiscard]] std::vector<maps::Box> detect(const maps::Scan& scan,
                                              const GroundResult& ground) const override;
};

}  // namespace stillmap::mapping
