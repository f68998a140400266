// The three products of a sparse convolution on a CPU, for training (network.py calls them where
// this library was built; without it, and on a GPU, plain PyTorch does the same).
//
//   g++ -O3 -march=native -fopenmp -shared -fPIC sparse_products.cpp -o libsparse_products.so
//
// PyTorch alone has to gather the neighbourhood of every site, two thirds of it empty, into a
// matrix that is 27 times as large as the features; here only the pairs that exist are multiplied,
// in registers, 6 pairs by up to 64 channels at a time.
//
// Pairs of kernel position k are pairs_in[first[k] .. first[k + 1]) and likewise pairs_out, both
// ascending. All matrices are dense, row-major float32.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace {

/// Floats of a register, and the most registers beside each other: with 6 rows of them the sums
/// stay in registers. A vector wider than a register would live in memory.
#ifdef __AVX512F__
constexpr int kLanes = 16, kMost = 4;
#else
constexpr int kLanes = 8, kMost = 2;
#endif
constexpr int kRows = 6;
using Vector = float __attribute__((vector_size(kLanes * sizeof(float)), aligned(4), may_alias));

Vector load(const float* p) { return *reinterpret_cast<const Vector*>(p); }
void store(float* p, Vector v) { *reinterpret_cast<Vector*>(p) = v; }

/// out[po[r]] += in[pi[r]] * weight for R pairs and V vectors of columns.
template <int R, int V>
void multiply_block(const float* in, int in_channels, const float* weight, int out_channels,
                    const std::int32_t* pi, const std::int32_t* po, float* out) {
  Vector sums[R][V];
  const float* rows[R];
  for (int r = 0; r < R; ++r) {
    rows[r] = in + static_cast<std::ptrdiff_t>(pi[r]) * in_channels;
    for (int v = 0; v < V; ++v)
      sums[r][v] = load(out + static_cast<std::ptrdiff_t>(po[r]) * out_channels + v * kLanes);
  }
  for (int c = 0; c < in_channels; ++c) {
    Vector w[V];
    for (int v = 0; v < V; ++v)
      w[v] = load(weight + static_cast<std::ptrdiff_t>(c) * out_channels + v * kLanes);
    for (int r = 0; r < R; ++r)
      for (int v = 0; v < V; ++v) sums[r][v] += rows[r][c] * w[v];
  }
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < V; ++v)
      store(out + static_cast<std::ptrdiff_t>(po[r]) * out_channels + v * kLanes, sums[r][v]);
}

template <int V>
void multiply_columns(const float* in, int in_channels, const float* weight, int out_channels,
                      const std::int32_t* pi, const std::int32_t* po, std::ptrdiff_t n,
                      float* out) {
  std::ptrdiff_t i = 0;
  for (; i + kRows <= n; i += kRows)
    multiply_block<kRows, V>(in, in_channels, weight, out_channels, pi + i, po + i, out);
  for (; i < n; ++i)
    multiply_block<1, V>(in, in_channels, weight, out_channels, pi + i, po + i, out);
}

void multiply_pairs(const float* in, int in_channels, const float* weight, int out_channels,
                    const std::int32_t* pi, const std::int32_t* po, std::ptrdiff_t n, float* out) {
  for (int column = 0; column < out_channels;) {
    const int vectors = (out_channels - column) / kLanes;
    const float* w = weight + column;
    float* o = out + column;
    if (vectors >= kMost) {
      multiply_columns<kMost>(in, in_channels, w, out_channels, pi, po, n, o);
      column += kMost * kLanes;
    } else if (vectors >= 2) {
      multiply_columns<2>(in, in_channels, w, out_channels, pi, po, n, o);
      column += 2 * kLanes;
    } else {
      multiply_columns<1>(in, in_channels, w, out_channels, pi, po, n, o);
      column += kLanes;
    }
  }
}

/// sums[R][V] over pairs of in[.][c + r] * gradient[.][v].
template <int R, int V>
void accumulate_block(const float* in, int in_channels, const float* gradient, int out_channels,
                      const std::int32_t* pi, const std::int32_t* po, std::ptrdiff_t n,
                      float* weight) {
  Vector sums[R][V] = {};
  for (std::ptrdiff_t i = 0; i < n; ++i) {
    const float* a = in + static_cast<std::ptrdiff_t>(pi[i]) * in_channels;
    const float* b = gradient + static_cast<std::ptrdiff_t>(po[i]) * out_channels;
    Vector g[V];
    for (int v = 0; v < V; ++v) g[v] = load(b + v * kLanes);
    for (int r = 0; r < R; ++r)
      for (int v = 0; v < V; ++v) sums[r][v] += a[r] * g[v];
  }
  for (int r = 0; r < R; ++r)
    for (int v = 0; v < V; ++v)
      store(weight + static_cast<std::ptrdiff_t>(r) * out_channels + v * kLanes, sums[r][v]);
}

template <int V>
void accumulate_columns(const float* in, int in_channels, const float* gradient, int out_channels,
                        const std::int32_t* pi, const std::int32_t* po, std::ptrdiff_t n,
                        float* weight) {
  int c = 0;
  for (; c + kRows <= in_channels; c += kRows)
    accumulate_block<kRows, V>(in + c, in_channels, gradient, out_channels, pi, po, n,
                               weight + static_cast<std::ptrdiff_t>(c) * out_channels);
  for (; c < in_channels; ++c)
    accumulate_block<1, V>(in + c, in_channels, gradient, out_channels, pi, po, n,
                           weight + static_cast<std::ptrdiff_t>(c) * out_channels);
}

}  // namespace

extern "C" {

/// out [n_out, out_channels] += sum over k of in[pair] * weight[k]. @param out_channels  a multiple
/// of 16.
void sparse_multiply(const float* in, int in_channels, const float* weight, int out_channels,
                     const std::int32_t* pairs_in, const std::int32_t* pairs_out,
                     const std::int64_t* first, int volume, std::int64_t n_out, float* out) {
  constexpr std::int64_t kParts = 8;
#pragma omp parallel for schedule(dynamic)
  for (std::int64_t part = 0; part < kParts; ++part) {
    const auto low = static_cast<std::int32_t>(n_out * part / kParts);
    const auto high = static_cast<std::int32_t>(n_out * (part + 1) / kParts);
    for (int k = 0; k < volume; ++k) {
      const std::int32_t* begin =
          std::lower_bound(pairs_out + first[k], pairs_out + first[k + 1], low);
      const std::int32_t* end = std::lower_bound(begin, pairs_out + first[k + 1], high);
      multiply_pairs(in, in_channels,
                     weight + static_cast<std::ptrdiff_t>(k) * in_channels * out_channels,
                     out_channels, pairs_in + (begin - pairs_out), begin, end - begin, out);
    }
  }
}

/// weight [volume, in_channels, out_channels] = sum over pairs of in^T * gradient.
void sparse_weight_gradient(const float* in, int in_channels, const float* gradient,
                            int out_channels, const std::int32_t* pairs_in,
                            const std::int32_t* pairs_out, const std::int64_t* first, int volume,
                            float* weight) {
#pragma omp parallel for schedule(dynamic)
  for (int k = 0; k < volume; ++k) {
    float* w = weight + static_cast<std::ptrdiff_t>(k) * in_channels * out_channels;
    const std::int32_t* pi = pairs_in + first[k];
    const std::int32_t* po = pairs_out + first[k];
    const std::ptrdiff_t n = first[k + 1] - first[k];
    for (int column = 0; column < out_channels;) {
      const int vectors = (out_channels - column) / kLanes;
      if (vectors >= kMost) {
        accumulate_columns<kMost>(in, in_channels, gradient + column, out_channels, pi, po, n,
                                  w + column);
        column += kMost * kLanes;
      } else {
        accumulate_columns<1>(in, in_channels, gradient + column, out_channels, pi, po, n,
                              w + column);
        column += kLanes;
      }
    }
  }
}

/// The pairs of a table [n_out, volume]; `nothing` marks the empty places. First call with null
/// pairs to learn `first` [volume + 1].
void sparse_pairs(const std::int64_t* table, std::int64_t n_out, int volume, std::int64_t nothing,
                  std::int64_t* first, std::int32_t* pairs_in, std::int32_t* pairs_out) {
  if (pairs_in == nullptr) {
    std::fill(first, first + volume + 1, 0);
    for (std::int64_t o = 0; o < n_out; ++o)
      for (int k = 0; k < volume; ++k) first[k + 1] += table[o * volume + k] != nothing;
    for (int k = 0; k < volume; ++k) first[k + 1] += first[k];
    return;
  }
  std::int64_t next[512];
  std::copy(first, first + volume, next);
  for (std::int64_t o = 0; o < n_out; ++o)
    for (int k = 0; k < volume; ++k)
      if (const std::int64_t in = table[o * volume + k]; in != nothing) {
        pairs_in[next[k]] = static_cast<std::int32_t>(in);
        pairs_out[next[k]++] = static_cast<std::int32_t>(o);
      }
}

}  // extern "C"
