#pragma once

#include <array>
#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// A row of channels for each site, each row on a cache line and filled up with zeros to whole
/// ones.
class FeatureRows {
 public:
  /// Floats in a cache line, and in the widest vector.
  static constexpr std::size_t kLine = 16;
  static constexpr std::size_t padded(std::size_t channels) {
    return (channels + kLine - 1) / kLine * kLine;
  }

  FeatureRows() = default;
  /// All 0.
  FeatureRows(std::size_t rows, std::size_t channels) { reshape(rows, channels); }
  /// Values are whatever was there before; memory is kept for the next shape.
  void reshape(std::size_t rows, std::size_t channels) {
    rows_ = rows;
    channels_ = channels;
    stride_ = padded(channels);
    if (lines_.size() < rows * stride_ / kLine) lines_.resize(rows * stride_ / kLine);
  }

  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t channels() const { return channels_; }
  /// Floats from one row to the next.
  [[nodiscard]] std::size_t stride() const { return stride_; }
  [[nodiscard]] float* data() { return lines_.empty() ? nullptr : lines_.front().values.data(); }
  [[nodiscard]] const float* data() const {
    return lines_.empty() ? nullptr : lines_.front().values.data();
  }
  [[nodiscard]] float* row(std::size_t row) { return data() + row * stride_; }
  [[nodiscard]] const float* row(std::size_t row) const { return data() + row * stride_; }

 private:
  struct alignas(64) Line {
    std::array<float, kLine> values;
  };
  std::size_t rows_ = 0;
  std::size_t channels_ = 0;
  std::size_t stride_ = 0;
  std::vector<Line> lines_;
};

}  // namespace stillmap::mapping
