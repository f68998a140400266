#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>

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
  FeatureRows(std::size_t rows, std::size_t channels) {
    reshape(rows, channels);
    std::fill_n(data(), rows_ * stride_, 0.0F);
  }
  /// Values are whatever memory holds: for those who write all of them.
  void reshape(std::size_t rows, std::size_t channels) {
    rows_ = rows;
    channels_ = channels;
    stride_ = padded(channels);
    // One at least, so that there is always something to point at.
    const std::size_t lines = std::max<std::size_t>(rows * stride_ / kLine, 1);
    if (!lines_ || lines > capacity_) {
      lines_ = std::make_unique_for_overwrite<Line[]>(lines);
      capacity_ = lines;
    }
  }

  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t channels() const { return channels_; }
  /// Floats from one row to the next.
  [[nodiscard]] std::size_t stride() const { return stride_; }
  [[nodiscard]] float* data() { return lines_ ? lines_[0].values : nullptr; }
  [[nodiscard]] const float* data() const { return lines_ ? lines_[0].values : nullptr; }
  [[nodiscard]] float* row(std::size_t row) { return data() + row * stride_; }
  [[nodiscard]] const float* row(std::size_t row) const { return data() + row * stride_; }

 private:
  struct alignas(64) Line {
    float values[kLine];
  };
  std::size_t rows_ = 0;
  std::size_t channels_ = 0;
  std::size_t stride_ = 0;
  std::size_t capacity_ = 0;
  std::unique_ptr<Line[]> lines_;
};

}  // namespace stillmap::mapping
