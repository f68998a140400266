#pragma once

#include "detection/voxelnext/feature_rows.hpp"
#include "detection/voxelnext/rulebook.hpp"
#include "detection/voxelnext/weights.hpp"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// What becomes of the sums of a convolution.
struct ConvolutionEnd {
  /// Negative sums become 0.
  bool relu = true;
  /// The output's rows hold something to which the sums are added (the other way through a residual
  /// block); else they start from the bias alone.
  bool add_to_output = false;
  /// The output once more, as the next convolution takes it.
  CodedRows* coded = nullptr;
};

/// Coded rows, of which a convolution may use some columns.
struct CodedColumns {
  CodedColumns(const CodedRows& rows, std::size_t first_column = 0)
      : first(rows.codes.get() + first_column), stride(rows.stride), steps(rows.steps.get()) {}
  const std::uint8_t* first = nullptr;
  std::size_t stride = 0;
  const float* steps = nullptr;
};
struct Rows {
  Rows(FeatureRows& rows) : first(rows.data()), stride(rows.stride()) {}
  Rows(float* first_value, std::size_t floats_to_next)
      : first(first_value), stride(floats_to_next) {}
  /// On a cache line.
  float* first = nullptr;
  std::size_t stride = 0;
};

/// Codes rows for a convolution; what is negative becomes 0.
[[nodiscard]] CodedRows coded(const FeatureRows& rows);

/// A convolution ready to be run: weights in the order in which they are read.
///
/// No rows are gathered or scattered: for each kernel position, some pairs of rows at a time keep
/// their output channels in registers, and each four input channels are broadcast onto four rows of
/// weights. Features (CodedRows) and weights (-63 to 63 times a step, one for each output channel)
/// are integers of a byte, whose products are summed up in integers that do not overflow, on one
/// kernel position. Sums of kernel positions are floats, added in one fixed order. So bits depend
/// on nothing but the inputs: not on threads, nor on the rows worked on beside them, nor on the
/// instruction set. Steps by row and by channel are what makes a byte enough: average precision is
/// that of floats (mapping/decisions/features_are_bytes.md).
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
  /// @param in   rows for each input cell of `book`, `in_channels` wide. Whole groups of channels
  /// are read; what lies beyond the last channel counts nothing.
  /// @param out  rows for each output cell, `out_channels` wide filled up to whole lines, which
  /// become 0; not the input.
  void run(const Rulebook& book, CodedColumns in, Rows out, const ConvolutionEnd& end) const;

  /// Multiplications that `run` needs.
  [[nodiscard]] double multiplications(const Rulebook& book) const {
    return static_cast<double>(book.pair_count()) *
           static_cast<double>(in_channels_ * out_channels_);
  }

 private:
  struct Panel {
    std::size_t begin;
    std::size_t width;
  };

  /// Of eight input channels.
  [[nodiscard]] std::size_t groups() const;
  /// Codes of one kernel position and panel begin here in `weight_`.
  [[nodiscard]] std::size_t weights_of(std::size_t position, std::size_t panel_begin) const;
  /// Takes the weights of one output channel, which stands in `column` of all.
  void code_channel(const Convolution& part, std::size_t channel, const Panel& panel,
                    std::size_t column);

  std::size_t kernel_volume_ = 0;
  std::size_t in_channels_ = 0;
  std::size_t out_channels_ = 0;
  /// Output columns that are in registers together, in floats; whole lines.
  std::vector<std::size_t> panels_;
  /// [kernel position][panel][four input channels][panel's columns][of the four]
  RowsOf<std::int8_t> weight_;
  /// Of each output channel's weights.
  FeatureRows weight_step_;
  FeatureRows bias_;
};

}  // namespace stillmap::mapping
