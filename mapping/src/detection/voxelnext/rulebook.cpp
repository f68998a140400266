#include "detection/voxelnext/rulebook.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>

namespace stillmap::mapping {

namespace {

int volume(const Triple& kernel) { return kernel.z * kernel.y * kernel.x; }

/// Kernel position, row-major over (z, y, x).
Triple position_of(int index, const Triple& kernel) {
  return {index / (kernel.x * kernel.y), index / kernel.x % kernel.y, index % kernel.x};
}

void check_odd(const Triple& kernel) {
  for (const int size : {kernel.z, kernel.y, kernel.x}) {
    if (size < 1 || size % 2 == 0 || size > 63)
      throw std::invalid_argument("kernel size: found " + std::to_string(size) +
                                  ", expected 1, 3, 5, ...");
  }
}

/// `cell` of the input under kernel position `at` belongs to this output cell; < 0: to none.
int output_of(int cell, int at, int kernel, int stride) {
  const int scaled = cell + kernel / 2 - at;
  return scaled < 0 || scaled % stride != 0 ? -1 : scaled / stride;
}

Triple strided_grid(const Triple& in, const Triple& kernel, const Triple& stride) {
  const auto cells = [](int n, int size, int step) {
    return (n + 2 * (size / 2) - size) / step + 1;
  };
  return {cells(in.z, kernel.z, stride.z), cells(in.y, kernel.y, stride.y),
          cells(in.x, kernel.x, stride.x)};
}

/// Output cells of a line that a line of input cells reaches.
class LineReach {
 public:
  explicit LineReach(std::size_t words) : words_(words) {}
  void clear() {
    if (any_) std::ranges::fill(words_, 0U);
    any_ = false;
  }
  void mark(int x) {
    words_[static_cast<std::size_t>(x) / 64] |= std::uint64_t{1}
                                                << (static_cast<unsigned>(x) % 64U);
    any_ = true;
  }
  [[nodiscard]] bool any() const { return any_; }
  [[nodiscard]] const std::vector<std::uint64_t>& words() const { return words_; }

 private:
  std::vector<std::uint64_t> words_;
  bool any_ = false;
};

/// Pairs of one kernel position.
struct PairWriter {
  std::uint32_t* in;
  std::uint32_t* out;
  std::size_t count;

  void add(std::uint32_t in_row, std::uint32_t out_row) {
    in[count] = in_row;
    out[count++] = out_row;
  }
};

/// Pairs of neighbouring kernel positions along x, whose first is `shift` from the middle.
void match_rows(const SiteSet& sites, const Triple& shift, std::vector<PairWriter>& writers) {
  const auto size = static_cast<int>(writers.size());
  for (const SiteSet::Line& line : sites.lines()) {
    const int z = line.z + shift.z, y = line.y + shift.y;
    if (z < 0 || z >= sites.grid().z || y < 0 || y >= sites.grid().y) continue;
    const SiteSet::Range other = sites.line(z, y);
    std::uint32_t begin = other.begin;
    for (std::uint32_t out = line.begin; out < line.end && begin < other.end; ++out) {
      const int x = sites[out].x + shift.x;
      while (begin < other.end && sites[begin].x < x) ++begin;
      for (std::uint32_t in = begin; in < other.end && sites[in].x < x + size; ++in)
        writers[static_cast<std::size_t>(sites[in].x - x)].add(in, out);
    }
  }
}

/// Pairs of a line of input cells with a line of output cells, of all kernel positions along x.
void match_strided(const SiteSet& in_sites, const SiteSet::Line& line, const SiteSet& out_sites,
                   const SiteSet::Range& out_line, int stride, std::vector<PairWriter>& writers) {
  const int size = static_cast<int>(writers.size()), half = size / 2;
  std::uint32_t begin = out_line.begin;
  for (std::uint32_t in = line.begin; in < line.end && begin < out_line.end; ++in) {
    // Output cell x has this one under its position `in.x + half - x * stride`.
    const int most = in_sites[in].x + half;
    while (begin < out_line.end && most - out_sites[begin].x * stride >= size) ++begin;
    for (std::uint32_t out = begin; out < out_line.end; ++out) {
      const int position = most - out_sites[out].x * stride;
      if (position < 0) break;
      writers[static_cast<std::size_t>(position)].add(in, out);
    }
  }
}

}  // namespace

Rulebook::Indices Rulebook::ascending(std::size_t count) {
  Indices out = room_for(count);
  std::iota(out.get(), out.get() + count, 0U);
  return out;
}

Rulebook Rulebook::submanifold(const SiteSet& sites, const Triple& kernel) {
  check_odd(kernel);
  const auto positions = static_cast<std::size_t>(volume(kernel)), half = positions / 2;
  Rulebook book;
  book.out_rows_ = sites.size();
  book.indices_.resize(2 * half + 1);
  book.lists_.resize(positions);
  book.indices_[2 * half] = ascending(sites.size());
  const std::uint32_t* same = book.indices_[2 * half].get();
  book.lists_[half] = {same, same, sites.size()};
  // Kernel positions that differ in x alone are found in one walk along two lines.
  const auto in_x = static_cast<std::size_t>(kernel.x);
  tbb::parallel_for(std::size_t{0}, half / in_x + 1, [&](std::size_t row) {
    std::vector<PairWriter> writers;
    for (std::size_t k = row * in_x; k < std::min((row + 1) * in_x, half); ++k) {
      Indices &in = book.indices_[2 * k], &out = book.indices_[2 * k + 1];
      in = room_for(sites.size());
      out = room_for(sites.size());
      writers.push_back({in.get(), out.get(), 0});
    }
    const Triple first = position_of(static_cast<int>(row * in_x), kernel);
    match_rows(sites, {first.z - kernel.z / 2, first.y - kernel.y / 2, -(kernel.x / 2)}, writers);
    for (std::size_t i = 0; i < writers.size(); ++i) {
      const auto& [in, out, count] = writers[i];
      book.lists_[row * in_x + i] = {in, out, count};
      book.lists_[positions - 1 - row * in_x - i] = {out, in, count};
    }
  });
  book.find_tiles();
  return book;
}

Rulebook Rulebook::identity(std::size_t rows) {
  Rulebook book;
  book.out_rows_ = rows;
  book.indices_.push_back(ascending(rows));
  const std::uint32_t* same = book.indices_.front().get();
  book.lists_.push_back({same, same, rows});
  book.find_tiles();
  return book;
}

Rulebook Rulebook::submanifold_at(const SiteSet& sites, const Triple& kernel,
                                  const std::vector<std::uint32_t>& rows) {
  check_odd(kernel);
  const auto positions = static_cast<std::size_t>(volume(kernel));
  Rulebook book;
  book.out_rows_ = rows.size();
  book.indices_.resize(2 * positions);
  book.lists_.resize(positions);
  for (std::size_t k = 0; k < positions; ++k) {
    const Triple at = position_of(static_cast<int>(k), kernel);
    Indices &in = book.indices_[2 * k], &out = book.indices_[2 * k + 1];
    in = room_for(rows.size());
    out = room_for(rows.size());
    std::size_t count = 0;
    for (std::size_t row = 0; row < rows.size(); ++row) {
      const Triple& cell = sites[rows[row]];
      const std::uint32_t found =
          sites.find({cell.z + at.z - kernel.z / 2, cell.y + at.y - kernel.y / 2,
                      cell.x + at.x - kernel.x / 2});
      if (found == SiteSet::kNone) continue;
      in[count] = found;
      out[count++] = static_cast<std::uint32_t>(row);
    }
    book.lists_[k] = {in.get(), out.get(), count};
  }
  book.find_tiles();
  return book;
}

Rulebook Rulebook::strided(const SiteSet& in_sites, const SiteSet& out_sites, const Triple& kernel,
                           const Triple& stride) {
  check_odd(kernel);
  const auto positions = static_cast<std::size_t>(volume(kernel));
  Rulebook book;
  book.out_rows_ = out_sites.size();
  book.indices_.resize(2 * positions);
  book.lists_.resize(positions);
  const auto in_x = static_cast<std::size_t>(kernel.x);
  tbb::parallel_for(std::size_t{0}, positions / in_x, [&](std::size_t row) {
    const std::size_t most = std::min(in_sites.size(), out_sites.size());
    std::vector<PairWriter> writers;
    for (std::size_t k = row * in_x; k < (row + 1) * in_x; ++k) {
      book.indices_[2 * k] = room_for(most);
      book.indices_[2 * k + 1] = room_for(most);
      writers.push_back({book.indices_[2 * k].get(), book.indices_[2 * k + 1].get(), 0});
    }
    const Triple at = position_of(static_cast<int>(row * in_x), kernel);
    for (const SiteSet::Line& line : in_sites.lines()) {
      const int z = output_of(line.z, at.z, kernel.z, stride.z);
      const int y = output_of(line.y, at.y, kernel.y, stride.y);
      if (z < 0 || z >= out_sites.grid().z || y < 0 || y >= out_sites.grid().y) continue;
      match_strided(in_sites, line, out_sites, out_sites.line(z, y), stride.x, writers);
    }
    for (std::size_t i = 0; i < in_x; ++i)
      book.lists_[row * in_x + i] = {writers[i].in, writers[i].out, writers[i].count};
  });
  book.find_tiles();
  return book;
}

void Rulebook::find_tiles() {
  tile_begins_.resize(lists_.size() * (tiles() + 1));
  for (std::size_t k = 0; k < lists_.size(); ++k) {
    const Pairs& list = lists_[k];
    const std::uint32_t* from = list.out;
    for (std::size_t tile = 0; tile <= tiles(); ++tile) {
      from = std::lower_bound(from, list.out + list.count, tile * kTileRows);
      tile_begins_[k * (tiles() + 1) + tile] = static_cast<std::uint32_t>(from - list.out);
    }
  }
}

Rulebook::Pairs Rulebook::pairs(std::size_t position, std::size_t tile) const {
  const std::uint32_t* begins = &tile_begins_[position * (tiles() + 1) + tile];
  const Pairs& list = lists_[position];
  return {list.in + begins[0], list.out + begins[0], begins[1] - begins[0]};
}

std::size_t Rulebook::pair_count() const {
  return std::accumulate(lists_.begin(), lists_.end(), std::size_t{0},
                         [](std::size_t sum, const Pairs& list) { return sum + list.count; });
}

SiteSet reached_by(const SiteSet& in, const Triple& kernel, const Triple& stride,
                   std::span<const std::uint8_t> dilates) {
  check_odd(kernel);
  if (!dilates.empty() && dilates.size() != in.size()) {
    throw std::invalid_argument("cells that dilate: found " + std::to_string(dilates.size()) +
                                ", expected " + std::to_string(in.size()));
  }
  SiteSet out(strided_grid(in.grid(), kernel, stride));
  LineReach all(out.words_in_line()), middle(out.words_in_line());
  const auto mark_line = [&](int z, int y, const LineReach& reach) {
    if (z >= 0 && z < out.grid().z && y >= 0 && y < out.grid().y)
      out.mark_line(z, y, reach.words());
  };
  for (const SiteSet::Line& line : in.lines()) {
    all.clear();
    middle.clear();
    for (std::uint32_t site = line.begin; site < line.end; ++site) {
      const bool dilated = dilates.empty() || dilates[site] != 0;
      const int first = dilated ? 0 : kernel.x / 2, last = dilated ? kernel.x : kernel.x / 2 + 1;
      for (int at = first; at < last; ++at) {
        const int x = output_of(in[site].x, at, kernel.x, stride.x);
        if (x >= 0 && x < out.grid().x) (dilated ? all : middle).mark(x);
      }
    }
    for (int at_z = 0; at_z < kernel.z && all.any(); ++at_z) {
      for (int at_y = 0; at_y < kernel.y; ++at_y) {
        mark_line(output_of(line.z, at_z, kernel.z, stride.z),
                  output_of(line.y, at_y, kernel.y, stride.y), all);
      }
    }
    if (middle.any()) {
      mark_line(output_of(line.z, kernel.z / 2, kernel.z, stride.z),
                output_of(line.y, kernel.y / 2, kernel.y, stride.y), middle);
    }
  }
  out.number_sites();
  return out;
}

}  // namespace stillmap::mapping
