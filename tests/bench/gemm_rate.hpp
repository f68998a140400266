#pragma once

namespace stillmap::test {

/// Rate [flop/s] for each thread of Eigen's product of two float matrices of 512 x 512, on each of
/// `threads` threads its own at the same time, by the processor's time: the best of some tries.
[[nodiscard]] double gemm_flops(int threads);

}  // namespace stillmap::test
