#pragma once

#include "build/scan_stages.hpp"

#include <stillmap/mapping/progress.hpp>

#include <cstddef>
#include <functional>
#include <vector>

namespace stillmap::mapping {

/// Processes scans, several at once, and hands them on one at a time in the order of `indices`.
///
/// At most two scans a thread are in flight, so memory does not grow with the number of scans.
/// @param threads  0 = all cores; 1 = on the caller's thread, without a pool.
/// @param process  called from several threads at once.
/// @param take     called from one thread at a time.
/// @throws Cancelled before the next scan once `cancel` is set, and whatever the two callables
/// throw.
void process_in_order(const std::vector<std::size_t>& indices, int threads,
                      const std::function<ProcessedScan(std::size_t)>& process,
                      const std::function<void(const ProcessedScan&)>& take,
                      const CancelFlag& cancel);

}  // namespace stillmap::mapping
