#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>

namespace stillmap::mapping {

/// A row of channels for each site, each row on a cache line and filled up with zeros to whole
/// ones.
template <typename T>
class RowsOf {
 public:
  /// Values in a cache line, and in the widest vector.
  static constexpr std::size_t kLine = 64 / sizeof(T);
  static constexpr std::size_t padded(std::size_t channels) {
    return (channels + kLine - 1) / kLine * kLine;
  }

  RowsOf() = default;
  /// All 0.
  RowsOf(std::size_t rows, std::size_t channels) {
    reshape(rows, channels);
    std::fill_n(data(), rows_ * stride_, T{0});
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
  /// Values from one row to the next.
  [[nodiscard]] std::size_t stride() const { return stride_; }
  [[nodiscard]] T* data() { return lines_ ? lines_[0].values : nullptr; }
  [[nodiscard]] const T* data() const { return lines_ ? lines_[0].values : nullptr; }
  [[nodiscard]] T* row(std::size_t row) { return data() + row * stride_; }
  [[nodiscard]] const T* row(std::size_t row) const { return data() + row * stride_; }

 private:
  struct alignas(64) Line {
    T values[kLine];
  };
  std::size_t rows_ = 0;
  std::size_t channels_ = 0;
  std::size_t stride_ = 0;
  std::size_t capacity_ = 0;
  std::unique_ptr<Line[]> lines_;
};

using FeatureRows = RowsOf<float>;

/// Feature rows without negative values as integers of 0 to 127: value = step * code, with one step
/// for each row, so that its largest value has the code 127. A row that holds something that is no
/// number has codes 0 and the step NaN.
struct CodedRows {
  static constexpr float kMost = 127.0F;
  /// Rows whose largest value is smaller are 0.
  static constexpr float kLeast = 0x1p-100F;

  /// Bytes from one row to the next.
  std::size_t stride = 0;
  std::unique_ptr<std::uint8_t[]> codes;
  /// Of each row.
  std::unique_ptr<float[]> steps;

  /// Channels that a convolution reads at once.
  static constexpr std::size_t kGroup = 8;

  /// Values are whatever memory holds.
  void reshape(std::size_t rows, std::size_t channels) {
    stride = FeatureRows::padded(channels);
    // One group more: a convolution of the last columns reads whole groups.
    codes = std::make_unique_for_overwrite<std::uint8_t[]>(rows * stride + kGroup);
    steps = std::make_unique_for_overwrite<float[]>(rows);
  }
  [[nodiscard]] std::uint8_t* row(std::size_t row) { return codes.get() + row * stride; }
};

}  // namespace stillmap::mapping
