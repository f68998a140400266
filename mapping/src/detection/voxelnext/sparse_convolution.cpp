#include "detection/voxelnext/sparse_convolution.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
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

/// Channels that are summed up before sums widen to 32 bits.
inline constexpr std::size_t kGroup = CodedRows::kGroup;
/// Neighbouring channels of one output in the weights.
inline constexpr std::size_t kQuad = 4;
/// Of either sign. The sum of four products with codes of features fits 16 bits:
/// 4 * 127 * 63 < 2^15.
inline constexpr float kMostWeightCode = 63.0F;

/// Pairs of one kernel position on one panel of output columns.
struct PanelTask {
  const std::uint8_t* in = nullptr;
  std::size_t in_stride = 0;
  const float* in_step = nullptr;
  /// Of input channels.
  std::size_t groups = 0;
  /// At the panel's first column of the tile's first row, in the weights' steps.
  float* sums = nullptr;
  std::size_t sums_stride = 0;
  std::size_t first_row = 0;
  const std::int8_t* weight = nullptr;
  Rulebook::Pairs pairs;
};

/// Rows of a tile, [begin, end).
struct EndTask {
  std::size_t begin = 0;
  std::size_t end = 0;
  std::size_t width = 0;
  const float* sums = nullptr;
  const float* weight_step = nullptr;
  const float* bias = nullptr;
  Rows out;
};

}  // namespace stillmap::mapping
#endif

HWY_BEFORE_NAMESPACE();
namespace stillmap::mapping::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Lanes = hn::CappedTag<float, FeatureRows::kLine>;
using IntLanes = hn::RebindToSigned<Lanes>;
using V = hn::Vec<Lanes>;
using VInt = hn::Vec<IntLanes>;

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3 || HWY_TARGET == HWY_AVX3_DL || \
    HWY_TARGET == HWY_SSE4 || HWY_TARGET == HWY_SSSE3
/// Four codes of a byte in each lane.
using Quads = VInt;
HWY_INLINE Quads load_quads(const std::int8_t* at) {
  return hn::Load(IntLanes(), reinterpret_cast<const std::int32_t*>(at));
}
/// The same four in every lane.
HWY_INLINE Quads same_quads(const std::uint8_t* at) {
  std::int32_t four = 0;
  std::memcpy(&four, at, sizeof four);
  return hn::Set(IntLanes(), four);
}
/// sum + (four products) + (four products) in each lane. Sums of 16 bits do not overflow.
HWY_INLINE VInt add_products_of(Quads in0, Quads weight0, Quads in1, Quads weight1, VInt sum) {
#if HWY_TARGET == HWY_AVX3_DL
  return VInt{_mm512_dpbusd_epi32(_mm512_dpbusd_epi32(sum.raw, in0.raw, weight0.raw), in1.raw,
                                  weight1.raw)};
#elif HWY_TARGET == HWY_AVX3
  const __m512i both = _mm512_add_epi16(_mm512_maddubs_epi16(in0.raw, weight0.raw),
                                        _mm512_maddubs_epi16(in1.raw, weight1.raw));
  return hn::Add(sum, VInt{_mm512_madd_epi16(both, _mm512_set1_epi16(1))});
#elif HWY_TARGET == HWY_AVX2
  const __m256i both = _mm256_add_epi16(_mm256_maddubs_epi16(in0.raw, weight0.raw),
                                        _mm256_maddubs_epi16(in1.raw, weight1.raw));
  return hn::Add(sum, VInt{_mm256_madd_epi16(both, _mm256_set1_epi16(1))});
#else
  const __m128i both = _mm_add_epi16(_mm_maddubs_epi16(in0.raw, weight0.raw),
                                     _mm_maddubs_epi16(in1.raw, weight1.raw));
  return hn::Add(sum, VInt{_mm_madd_epi16(both, _mm_set1_epi16(1))});
#endif
}
#else
/// Four codes of a byte in each lane.
template <typename Code>
struct QuadsOf {
  std::array<Code, kQuad * hn::MaxLanes(Lanes())> codes;
};
QuadsOf<std::int8_t> load_quads(const std::int8_t* at) {
  QuadsOf<std::int8_t> quads;
  std::copy_n(at, quads.codes.size(), quads.codes.begin());
  return quads;
}
/// The same four in every lane.
QuadsOf<std::uint8_t> same_quads(const std::uint8_t* at) {
  QuadsOf<std::uint8_t> quads;
  for (std::size_t i = 0; i < quads.codes.size(); ++i) quads.codes[i] = at[i % kQuad];
  return quads;
}
/// sum + (four products) + (four products) in each lane.
VInt add_products_of(const QuadsOf<std::uint8_t>& in0, const QuadsOf<std::int8_t>& weight0,
                     const QuadsOf<std::uint8_t>& in1, const QuadsOf<std::int8_t>& weight1,
                     VInt sum) {
  alignas(64) std::array<std::int32_t, hn::MaxLanes(Lanes())> products{};
  for (std::size_t i = 0; i < in0.codes.size(); ++i)
    products[i / kQuad] += in0.codes[i] * weight0.codes[i] + in1.codes[i] * weight1.codes[i];
  return hn::Add(sum, hn::Load(IntLanes(), products.data()));
}
#endif

/// Adds `in * weight` to the output of pairs [first, first + kPairs), kVectors wide. The sums stay
/// in registers. The task is a copy: stores to rows cannot change it, so nothing is read twice.
template <std::size_t kVectors, std::size_t kPairs>
HWY_INLINE void add_products(const PanelTask task, std::size_t first) {
  const Lanes d;
  constexpr std::size_t kLanes = hn::MaxLanes(Lanes()), kBytes = kQuad * kLanes;
  std::array<const std::uint8_t*, kPairs> in;
  std::array<VInt, kPairs * kVectors> sums;
  for (std::size_t p = 0; p < kPairs; ++p) {
    in[p] = task.in + task.pairs.in[first + p] * task.in_stride;
    for (std::size_t v = 0; v < kVectors; ++v) sums[p * kVectors + v] = hn::Zero(IntLanes());
  }
  const std::int8_t* weight = task.weight;
  for (std::size_t g = 0; g < task.groups; ++g, weight += 2 * kVectors * kBytes) {
    std::array<decltype(load_quads(weight)), 2 * kVectors> row;
    for (std::size_t v = 0; v < 2 * kVectors; ++v) row[v] = load_quads(weight + v * kBytes);
    for (std::size_t p = 0; p < kPairs; ++p) {
      const auto low = same_quads(in[p] + g * kGroup);
      const auto high = same_quads(in[p] + g * kGroup + kQuad);
      for (std::size_t v = 0; v < kVectors; ++v) {
        VInt& sum = sums[p * kVectors + v];
        sum = add_products_of(low, row[v], high, row[kVectors + v], sum);
      }
    }
  }
  for (std::size_t p = 0; p < kPairs; ++p) {
    const V step = hn::Set(d, task.in_step[task.pairs.in[first + p]]);
    float* to = task.sums + (task.pairs.out[first + p] - task.first_row) * task.sums_stride;
    for (std::size_t v = 0; v < kVectors; ++v, to += kLanes) {
      // Not MulAdd: it rounds once where there is such an instruction, and else twice.
      const V sum = hn::Mul(hn::ConvertTo(d, sums[p * kVectors + v]), step);
      hn::Store(hn::Add(sum, hn::Load(d, to)), d, to);
    }
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
    // 32 registers: up to 16 of sums, 4 of weights, and what is multiplied.
    if (lines == 1) add_all<1, 8>(task);
    if (lines == 2) add_all<2, 8>(task);
  } else if constexpr (kLanes == FeatureRows::kLine / 2) {
    // 16 registers: 6 of sums, 4 of weights, and what is multiplied.
    add_all<2, 3>(task);
  } else {
    add_all<FeatureRows::kLine / kLanes, 1>(task);
  }
}

/// Lines of output columns that go into registers together.
std::size_t widest_panel() { return hn::MaxLanes(Lanes()) == FeatureRows::kLine ? 2 : 1; }

/// Bits of floats without sign are in the order of the floats, and those of what is no number above
/// all others.
HWY_INLINE VInt larger(VInt largest, V value) {
  return hn::Max(largest, hn::BitCast(IntLanes(), hn::Abs(value)));
}

/// What the next convolution takes: see CodedRows. @param largest  of the row.
HWY_INLINE void code_row(const float* values, std::size_t width, VInt largest, std::uint8_t* codes,
                         float& step) {
  const Lanes d;
  const hn::Rebind<std::uint8_t, Lanes> bytes;
  const float most = hn::GetLane(hn::BitCast(d, hn::MaxOfLanes(IntLanes(), largest)));
  const bool is_finite = most <= std::numeric_limits<float>::max();
  if (!is_finite || most < CodedRows::kLeast) {
    step = is_finite ? 0.0F : std::numeric_limits<float>::quiet_NaN();
    std::fill_n(codes, width, std::uint8_t{0});
    return;
  }
  step = most / CodedRows::kMost;
  const V steps = hn::Set(d, CodedRows::kMost / most);
  for (std::size_t k = 0; k < width; k += hn::Lanes(d)) {
    const V value = hn::Load(d, values + k);
    hn::StoreU(hn::DemoteTo(bytes, hn::NearestInt(hn::Mul(value, steps))), bytes, codes + k);
  }
}

void code_rows(const FeatureRows& rows, std::size_t begin, std::size_t end, CodedRows& out) {
  const Lanes d;
  for (std::size_t row = begin; row < end; ++row) {
    VInt largest = hn::Zero(IntLanes());
    for (std::size_t k = 0; k < rows.stride(); k += hn::Lanes(d))
      largest = larger(largest, hn::Load(d, rows.row(row) + k));
    code_row(rows.row(row), rows.stride(), largest, out.row(row), out.steps[row]);
  }
}

/// What becomes of a tile's sums.
void end_rows(const EndTask& task, const ConvolutionEnd& how) {
  const Lanes d;
  const float* sums = task.sums;
  for (std::size_t row = task.begin; row < task.end; ++row, sums += task.width) {
    float* values = task.out.first + row * task.out.stride;
    VInt largest = hn::Zero(IntLanes());
    for (std::size_t k = 0; k < task.width; k += hn::Lanes(d)) {
      V value = hn::Mul(hn::Load(d, sums + k), hn::Load(d, task.weight_step + k));
      value = hn::Add(value, hn::Load(d, task.bias + k));
      if (how.add_to_output) value = hn::Add(value, hn::Load(d, values + k));
      if (how.relu) value = hn::Max(value, hn::Zero(d));
      largest = larger(largest, value);
      hn::Store(value, d, values + k);
    }
    if (how.coded != nullptr)
      code_row(values, task.width, largest, how.coded->row(row), how.coded->steps[row]);
  }
}

}  // namespace stillmap::mapping::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace stillmap::mapping {
HWY_EXPORT(add_panel);
HWY_EXPORT(widest_panel);
HWY_EXPORT(code_rows);
HWY_EXPORT(end_rows);

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

CodedRows coded(const FeatureRows& rows) {
  CodedRows out;
  out.reshape(rows.rows(), rows.stride());
  constexpr std::size_t kGrain = 1024;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rows.rows(), kGrain),
                    [&](const auto& range) {
                      HWY_DYNAMIC_DISPATCH(code_rows)(rows, range.begin(), range.end(), out);
                    });
  return out;
}

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
  weight_ = RowsOf<std::int8_t>(kernel_volume_ * groups(), kGroup * width);
  weight_step_ = FeatureRows(1, width);
  bias_ = FeatureRows(1, width);
  std::size_t column = 0, panel_begin = 0;
  auto panel = panels_.begin();
  for (const Convolution* part : side_by_side) {
    const auto channels = static_cast<std::size_t>(part->out_channels);
    for (std::size_t j = 0; j < channels; ++j, ++column) {
      if (column >= panel_begin + *panel) panel_begin += *panel++;
      bias_.data()[column] = part->bias[j];
      code_channel(*part, j, {panel_begin, *panel}, column);
    }
  }
}

std::size_t SparseConvolution::groups() const { return (in_channels_ + kGroup - 1) / kGroup; }

std::size_t SparseConvolution::weights_of(std::size_t position, std::size_t panel_begin) const {
  return kGroup * groups() * (position * bias_.stride() + panel_begin);
}

void SparseConvolution::code_channel(const Convolution& part, std::size_t channel,
                                     const Panel& panel, std::size_t column) {
  const auto channels = static_cast<std::size_t>(part.out_channels);
  float largest = 0.0F;
  for (std::size_t i = channel; i < part.weight.size(); i += channels)
    largest = std::max(largest, std::abs(part.weight[i]));
  if (largest < CodedRows::kLeast) return;
  const float step = largest / kMostWeightCode;
  weight_step_.data()[column] = step;
  for (std::size_t k = 0; k < kernel_volume_; ++k) {
    std::int8_t* codes =
        weight_.data() + weights_of(k, panel.begin) + kQuad * (column - panel.begin);
    for (std::size_t c = 0; c < in_channels_; ++c) {
      const float value = part.weight[(k * in_channels_ + c) * channels + channel];
      codes[c / kQuad * kQuad * panel.width + c % kQuad] =
          static_cast<std::int8_t>(std::lrint(value / step));
    }
  }
}

void SparseConvolution::run(const Rulebook& book, CodedColumns in, Rows out,
                            const ConvolutionEnd& end) const {
  if (book.kernel_volume() != kernel_volume_)
    throw std::invalid_argument("convolution: kernel and rulebook differ in volume");
  const std::size_t width = bias_.stride();
  if (end.coded != nullptr) end.coded->reshape(book.out_rows(), width);
  tbb::parallel_for(std::size_t{0}, book.tiles(), [&](std::size_t tile) {
    const std::size_t begin = tile * Rulebook::kTileRows;
    const std::size_t stop = std::min(begin + Rulebook::kTileRows, book.out_rows());
    FeatureRows sums(stop - begin, width);
    for (std::size_t k = 0; k < kernel_volume_; ++k) {
      const Rulebook::Pairs pairs = book.pairs(k, tile);
      std::size_t column = 0;
      for (const std::size_t panel : panels_) {
        HWY_DYNAMIC_DISPATCH(add_panel)
        ({in.first, in.stride, in.steps, groups(), sums.data() + column, width, begin,
          weight_.data() + weights_of(k, column), pairs},
         panel / FeatureRows::kLine);
        column += panel;
      }
    }
    HWY_DYNAMIC_DISPATCH(end_rows)
    ({begin, stop, width, sums.data(), weight_step_.data(), bias_.data(), out}, end);
  });
}

}  // namespace stillmap::mapping
#endif  // HWY_ONCE
