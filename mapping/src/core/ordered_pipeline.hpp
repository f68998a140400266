#pragma once

#include <stillmap/mapping/progress.hpp>

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <cstddef>
#include <memory>
#include <utility>

namespace stillmap::mapping {

/// Calls `process(i)` for i in [0, count), several at once, and hands the results to `take` one at
/// a time in order.
///
/// At most two results a thread are in flight, enough that the serial end never waits, so memory
/// does not grow with `count`.
/// @param threads  0 = all cores; 1 = on the caller's thread, without a pool.
/// @throws Cancelled before the next one once `cancel` is set, and whatever the two callables
/// throw.
template <typename Process, typename Take>
void process_in_order(std::size_t count, int threads, const Process& process, const Take& take,
                      const CancelFlag& cancel) {
  if (threads == 1) {
    for (std::size_t i = 0; i < count; ++i) {
      if (cancel) throw Cancelled();
      take(process(i));
    }
    return;
  }
  using Shared = std::shared_ptr<decltype(process(std::size_t{}))>;
  std::size_t next = 0;
  const auto source = [&](tbb::flow_control& control) -> std::size_t {
    if (cancel) throw Cancelled();
    if (next == count) {
      control.stop();
      return 0;
    }
    return next++;
  };
  const auto middle = [&](std::size_t i) -> Shared {
    return std::make_shared<typename Shared::element_type>(process(i));
  };
  const auto sink = [&](const Shared& result) { take(std::move(*result)); };
  tbb::task_arena arena(threads == 0 ? tbb::task_arena::automatic : threads);
  arena.execute([&] {
    using tbb::filter_mode;
    const auto tokens = 2 * static_cast<std::size_t>(arena.max_concurrency());
    tbb::parallel_pipeline(
        tokens, tbb::make_filter<void, std::size_t>(filter_mode::serial_in_order, source) &
                    tbb::make_filter<std::size_t, Shared>(filter_mode::parallel, middle) &
                    tbb::make_filter<Shared, void>(filter_mode::serial_in_order, sink));
  });
}

}  // namespace stillmap::mapping
