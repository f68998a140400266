#include "views/range_view.hpp"

#include <algorithm>
#include <cstring>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// What a bin holds, two bits each: most have one range, so that a view takes half the space.
enum : unsigned { kEmpty = 0, kGroundOnly = 1, kOneSurface = 2, kTwoRanges = 3 };

constexpr std::size_t kHeaderBytes = 4;
constexpr std::size_t kKindBytesPerRow = ViewGrid::kColumns / 4;

void put(std::string& bytes, std::uint16_t value) {
  bytes.push_back(static_cast<char>(value & 0xFFU));
  bytes.push_back(static_cast<char>(value >> 8U));
}

std::uint16_t get(std::string_view bytes, std::size_t at) {
  return static_cast<std::uint16_t>(static_cast<unsigned char>(bytes[at]) |
                                    (static_cast<unsigned char>(bytes[at + 1]) << 8U));
}

}  // namespace

// first row, rows; a row each: its kinds (all zero for an empty row); then the ranges in order.
std::string RangeView::to_bytes() const {
  const std::size_t rows = bins_.size() / ViewGrid::kColumns;
  std::string bytes, ranges;
  put(bytes, static_cast<std::uint16_t>(first_row_));
  put(bytes, static_cast<std::uint16_t>(rows));
  bytes.resize(kHeaderBytes + rows * kKindBytesPerRow);
  ranges.reserve(2 * bins_.size());
  for (std::size_t i = 0; i < bins_.size(); ++i) {
    const Bin& b = bins_[i];
    unsigned kind = kEmpty;
    if (b.farthest != 0)
      kind = b.nearest == kNone ? kGroundOnly : b.nearest == b.farthest ? kOneSurface : kTwoRanges;
    char& packed = bytes[kHeaderBytes + i / 4];
    packed = static_cast<char>(static_cast<unsigned char>(packed) | (kind << (2U * (i % 4))));
    if (kind == kTwoRanges) put(ranges, b.nearest);
    if (kind != kEmpty) put(ranges, b.farthest);
  }
  return bytes + ranges;
}

RangeView RangeView::from_bytes(std::string_view bytes) {
  if (bytes.size() < kHeaderBytes) throw std::invalid_argument("range view: shorter than its head");
  RangeView view;
  view.first_row_ = get(bytes, 0);
  const std::size_t rows = get(bytes, 2);
  std::size_t at = kHeaderBytes + rows * kKindBytesPerRow;
  if (static_cast<std::size_t>(view.first_row_) + rows > ViewGrid::kRows || at > bytes.size())
    throw std::invalid_argument("range view: more rows than bytes");
  view.bins_.resize(rows * ViewGrid::kColumns);
  const auto next = [&] {
    if (at + 2 > bytes.size()) throw std::invalid_argument("range view: ranges end too early");
    at += 2;
    return get(bytes, at - 2);
  };
  for (std::size_t i = 0; i < view.bins_.size(); ++i) {
    const auto packed = static_cast<unsigned char>(bytes[kHeaderBytes + i / 4]);
    const unsigned kind = (packed >> (2U * (i % 4))) & 3U;
    if (kind == kEmpty) continue;
    Bin& b = view.bins_[i];
    if (kind == kTwoRanges) b.nearest = next();
    b.farthest = next();
    if (kind == kOneSurface) b.nearest = b.farthest;
  }
  if (at != bytes.size()) throw std::invalid_argument("range view: bytes left over");
  return view;
}

}  // namespace stillmap::mapping
