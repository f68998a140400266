#include "gemm_rate.hpp"

// This file alone is compiled for the machine's full instruction set. Under another name, so that
// the linker does not take its functions for those of the other files.
#define Eigen EigenForThisMachine
#include <Eigen/Core>

#include <algorithm>
#include <ctime>
#include <thread>
#include <vector>

namespace stillmap::test {

namespace {

constexpr int kSize = 512;
constexpr int kProducts = 4;
constexpr int kTries = 12;

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace

double gemm_flops(int threads) {
  using Matrix = Eigen::MatrixXf;
  std::vector<double> best_s(static_cast<std::size_t>(threads), 1e9);
  const auto work = [&](std::size_t thread) {
    const Matrix a = Matrix::Random(kSize, kSize), b = Matrix::Random(kSize, kSize);
    Matrix c = Matrix::Zero(kSize, kSize);
    for (int k = 0; k < kTries; ++k) {
      const double start_s = thread_seconds();
      for (int j = 0; j < kProducts; ++j) c.noalias() += a * b;
      best_s[thread] = std::min(best_s[thread], thread_seconds() - start_s);
    }
    // Otherwise nobody needs the product.
    volatile const float used = c(0, 0);
    static_cast<void>(used);
  };
  std::vector<std::jthread> team;
  for (int k = 0; k < threads; ++k) team.emplace_back(work, static_cast<std::size_t>(k));
  team.clear();
  return 2.0 * kSize * kSize * kSize * kProducts / *std::max_element(best_s.begin(), best_s.end());
}

}  // namespace stillmap::test
