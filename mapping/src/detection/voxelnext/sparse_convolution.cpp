#include "detection/voxelnext/sparse_convolution.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <string>

// Compiled once for each instruction set; the best one is chosen when the program runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "detection/voxelnext/sparse_convolution.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef STILLMAP_SPARSE_CONVOLUTION_PANEL
#define STILLMAP_SPARSE_CONVOLUTION_PANEL
namespace stillmap::mapping {

/// Pairs of one kernel position on one panel of output columns.
struct PanelTask {
  const float* in = nullptr;
  std::size_t in_stride = 0;
  std::size_t in_channels = 0;
  /// At the panel's first column.
  float* out = nullptr;
  std::size_t out_stride = 0;
  const float* weight = nullptr;
  Rulebook::Pairs pairs;
};

}  // namespace stillmap::mapping
#endif

HWY_BEFORE_NAMESPACE();
namespace stillmap::mapping::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Lanes = hn::CappedTag<float, FeatureRows::kLine>;
using V = hn::Vec<Lanes>;

/// Adds `in * weight` to the output of pairs [first, first + kPairs), kVectors wide. The sums stay
/// in registers. The task is a copy: stores to rows cannot change it, so nothing is read twice.
template <std::size_t kVectors, std::size_t kPairs>
HWY_INLINE void add_products(const PanelTask task, std::size_t first) {
  const Lanes d;
  constexpr std::size_t kLanes = hn::MaxLanes(Lanes());
  std::array<const float*, kPairs> in;
  std::array<float*, kPairs> out;
  std::array<V, kPairs * kVectors> sums;
  for (std::size_t p = 0; p < kPairs; ++p) {
    in[p] = task.in + task.pairs.in[first + p] * task.in_stride;
    out[p] = task.out + task.pairs.out[first + p] * task.out_stride;
    for (std::size_t v = 0; v < kVectors; ++v)
      sums[p * kVectors + v] = hn::Load(d, out[p] + v * kLanes);
  }
  const float* weight = task.weight;
  for (std::size_t c = 0; c < task.in_channels; ++c, weight += kVectors * kLanes) {
    std::array<V, kVectors> row;
    for (std::size_t v = 0; v < kVectors; ++v) row[v] = hn::Load(d, weight + v * kLanes);
    for (std::size_t p = 0; p < kPairs; ++p) {
      const V value = hn::Set(d, in[p][c]);
      for (std::size_t v = 0; v < kVectors; ++v)
        sums[p * kVectors + v] = hn::MulAdd(value, row[v], sums[p * kVectors + v]);
    }
  }
  for (std::size_t p = 0; p < kPairs; ++p) {
    for (std::size_t v = 0; v < kVectors; ++v)
      hn::Store(sums[p * kVectors + v], d, out[p] + v * kLanes);
  }
}

template <std::size_t kVectors, std::size_t kPairs>
void add_all(const PanelTask& task) {
  std::size_t k = 0;
  for (; k + kPairs <= task.pairs.count; k += kPairs) add_products<kVectors, kPairs>(task, k);
  if constexpr (kPairs > 4) {
    if (k + 4 <= task.pairs.count) {
      add_products<kVectors, 4>(task, k);
      k += 4;
    }
  }
  if constexpr (kPairs > 2) {
    if (k + 2 <= task.pairs.count) {
      add_products<kVectors, 2>(task, k);
      k += 2;
    }
  }
  for (; k < task.pairs.count; ++k) add_products<kVectors, 1>(task, k);
}

/// @param lines  of the panel, 1 to widest_panel().
void add_panel(const PanelTask& task, std::size_t lines) {
  constexpr std::size_t kLanes = hn::MaxLanes(Lanes());
  if constexpr (kLanes == FeatureRows::kLine) {
    // 32 registers: 24 of sums, up to 4 of weights, one value.
    if (lines == 1) add_all<1, 8>(task);
    if (lines == 2) add_all<2, 8>(task);
    if (lines == 3) add_all<3, 8>(task);
    if (lines == 4) add_all<4, 6>(task);
  } else if constexpr (kLanes == FeatureRows::kLine / 2) {
    // 16 registers: 12 of sums, 2 of weights, one value.
    add_all<2, 6>(task);
  } else {
    add_all<FeatureRows::kLine / kLanes, 2>(task);
  }
}

/// Lines of output columns that go into registers together.
std::size_t widest_panel() { return hn::MaxLanes(Lanes()) == FeatureRows::kLine ? 4 : 1; }

/// Adds the bias to rows, or writes it there.
void start_rows(Rows out, std::size_t begin, std::size_t end, const float* bias, std::size_t width,
                bool add) {
  const Lanes d;
  for (std::size_t row = begin; row < end; ++row) {
    float* values = out.first + row * out.stride;
    for (std::size_t k = 0; k < width; k += hn::Lanes(d)) {
      const V start = hn::Load(d, bias + k);
      hn::Store(add ? hn::Add(start, hn::Load(d, values + k)) : start, d, values + k);
    }
  }
}

void cut_negative(Rows out, std::size_t begin, std::size_t end, std::size_t width) {
  const Lanes d;
  for (std::size_t row = begin; row < end; ++row) {
    float* values = out.first + row * out.stride;
    for (std::size_t k = 0; k < width; k += hn::Lanes(d))
      hn::Store(hn::Max(hn::Load(d, values + k), hn::Zero(d)), d, values + k);
  }
}

}  // namespace stillmap::mapping::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stillmap::mapping {
HWY_EXPORT(add_panel);
HWY_EXPORT(widest_panel);
HWY_EXPORT(start_rows);
HWY_EXPORT(cut_negative);

namespace {

/// Widths of at most `widest` lines each, as equal as can be.
std::vector<std::size_t> panels_of(std::size_t lines, std::size_t widest) {
  const std::size_t count = (lines + widest - 1) / widest;
  std::vector<std::size_t> out;
  for (std::size_t k = 0; k < count; ++k)
    out.push_back((lines * (k + 1) / count - lines * k / count) * FeatureRows::kLine);
  return out;
}

void check(const Convolution& convolution, const Convolution& first) {
  const auto volume = static_cast<std::size_t>(convolution.kernel_volume);
  const auto in = static_cast<std::size_t>(convolution.in_channels);
  const auto out = static_cast<std::size_t>(convolution.out_channels);
  if (convolution.kernel_volume < 1 || convolution.in_channels < 1 ||
      convolution.out_channels < 1 || convolution.weight.size() != volume * in * out ||
      convolution.bias.size() != out || convolution.kernel_volume != first.kernel_volume ||
      convolution.in_channels != first.in_channels) {
    throw std::invalid_argument("convolution: found " + std::to_string(convolution.weight.size()) +
                                " weights and " + std::to_string(convolution.bias.size()) +
                                " biases for the shape " + std::to_string(volume) + " x " +
                                std::to_string(in) + " x " + std::to_string(out));
  }
}

}  // namespace

SparseConvolution::SparseConvolution(const std::vector<const Convolution*>& side_by_side) {
  if (side_by_side.empty()) throw std::invalid_argument("convolution: none");
  for (const Convolution* part : side_by_side) {
    check(*part, *side_by_side.front());
    out_channels_ += static_cast<std::size_t>(part->out_channels);
  }
  kernel_volume_ = static_cast<std::size_t>(side_by_side.front()->kernel_volume);
  in_channels_ = static_cast<std::size_t>(side_by_side.front()->in_channels);
  const std::size_t width = FeatureRows::padded(out_channels_);
  panels_ = panels_of(width / FeatureRows::kLine, HWY_DYNAMIC_DISPATCH(widest_panel)());
  weight_ = FeatureRows(kernel_volume_ * in_channels_, width);
  bias_ = FeatureRows(1, width);
  // Panel and column in it of each output channel.
  std::size_t first = 0;
  for (const Convolution* part : side_by_side) {
    const auto channels = static_cast<std::size_t>(part->out_channels);
    for (std::size_t j = 0; j < channels; ++j) {
      bias_.data()[first + j] = part->bias[j];
      std::size_t panel_begin = 0, panel = 0;
      while (first + j >= panel_begin + panels_[panel]) panel_begin += panels_[panel++];
      for (std::size_t k = 0; k < kernel_volume_; ++k) {
        float* weight = weight_.row(k * in_channels_) + in_channels_ * panel_begin;
        for (std::size_t c = 0; c < in_channels_; ++c) {
          weight[c * panels_[panel] + first + j - panel_begin] =
              part->weight[(k * in_channels_ + c) * channels + j];
        }
      }
    }
    first += channels;
  }
}

void SparseConvolution::run(const Rulebook& book, ConstRows in, Rows out,
                            const ConvolutionEnd& end) const {
  if (book.kernel_volume() != kernel_volume_)
    throw std::invalid_argument("convolution: kernel and rulebook differ in volume");
  const std::size_t width = bias_.stride();
  tbb::parallel_for(std::size_t{0}, book.tiles(), [&](std::size_t tile) {
    const std::size_t begin = tile * Rulebook::kTileRows;
    const std::size_t stop = std::min(begin + Rulebook::kTileRows, book.out_rows());
    HWY_DYNAMIC_DISPATCH(start_rows)(out, begin, stop, bias_.data(), width, end.add_to_output);
    for (std::size_t k = 0; k < kernel_volume_; ++k) {
      const Rulebook::Pairs pairs = book.pairs(k, tile);
      std::size_t column = 0;
      for (const std::size_t panel : panels_) {
        HWY_DYNAMIC_DISPATCH(add_panel)
        ({in.first, in.stride, in_channels_, out.first + column, out.stride,
          weight_.row(k * in_channels_) + in_channels_ * column, pairs},
         panel / FeatureRows::kLine);
        column += panel;
      }
    }
    if (end.relu) HWY_DYNAMIC_DISPATCH(cut_negative)(out, begin, stop, width);
  });
}

}  // namespace stillmap::mapping
#endif  // HWY_ONCE
