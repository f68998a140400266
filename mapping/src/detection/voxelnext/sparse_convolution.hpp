#pragma once

#include "detection/voxelnext/feature_rows.hpp"
#include "detection/voxelnext/rulebook.hpp"
#include "detection/voxelnext/weights.hpp"

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// What becomes of the sums of a convolution.
struct ConvolutionEnd {
  /// Negative sums become 0.
  bool relu = true;
  /// The output's rows hold something to which the sums are added (the other way through a residual
  /// block); else they start from the bias alone.
  bool add_to_output = false;
};

/// Rows of a feature matrix, of which a convolution may use some columns.
struct ConstRows {
  ConstRows(const FeatureRows& rows) : first(rows.data()), stride(rows.stride()) {}
  ConstRows(const float* first_value, std::size_t floats_to_next)
      : first(first_value), stride(floats_to_next) {}
  const float* first = nullptr;
  std::size_t stride = 0;
};
struct Rows {
  Rows(FeatureRows& rows) : first(rows.data()), stride(rows.stride()) {}
  Rows(float* first_value, std::size_t floats_to_next)
      : first(first_value), stride(floats_to_next) {}
  /// On a cache line.
  float* first = nullptr;
  std::size_t stride = 0;
};

/// A convolution ready to be run: weights in the order in which they are read.
///
/// No rows are gathered or scattered: for each kernel position, some pairs of rows at a time keep
/// their output channels in registers, and each input channel is broadcast onto a row of weights.
/// Each output row is summed over kernel positions and input channels in one fixed order, so that
/// its bits depend on nothing but its inputs: not on threads, nor on the rows worked on beside it.
class SparseConvolution {
 public:
  /// Outputs of several convolutions of the same input, one after the other. All have the same
  /// kernel volume and input channels.
  /// @throws std::invalid_argument for shapes that do not meet.
  explicit SparseConvolution(const std::vector<const Convolution*>& side_by_side);
  explicit SparseConvolution(const Convolution& convolution)
      : SparseConvolution(std::vector<const Convolution*>{&convolution}) {}

  [[nodiscard]] std::size_t kernel_volume() const { return kernel_volume_; }
  [[nodiscard]] std::size_t in_channels() const { return in_channels_; }
  [[nodiscard]] std::size_t out_channels() const { return out_channels_; }

  /// Runs over all output rows on the threads of the caller's arena.
  /// @param in   rows for each input cell of `book`, at least `in_channels` wide.
  /// @param out  rows for each output cell, `out_channels` wide filled up to whole lines, which
  /// become 0; not the input.
  void run(const Rulebook& book, ConstRows in, Rows out, const ConvolutionEnd& end) const;

  /// Multiplications that `run` needs.
  [[nodiscard]] double multiplications(const Rulebook& book) const {
    return static_cast<double>(book.pair_count()) *
           static_cast<double>(in_channels_ * out_channels_);
  }

 private:
  std::size_t kernel_volume_ = 0;
  std::size_t in_channels_ = 0;
  std::size_t out_channels_ = 0;
  /// Output columns that are in registers together, in floats; whole lines.
  std::vector<std::size_t> panels_;
  /// [kernel position][panel][input channel][panel's columns]
  FeatureRows weight_;
  FeatureRows bias_;
};

}  // namespace stillmap::mapping
