#pragma once

namespace stillmap::test {

/// Rate [flop/s] of Eigen's product of two float matrices of 512 x 512, on each of `threads`
/// threads its own at the same time: the best of some tries, all threads together.
[[nodiscard]] double gemm_flops(int threads);

}  // namespace stillmap::test
