#include "build/scan_pipeline.hpp"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <memory>

namespace stillmap::mapping {
namespace {

/// Enough that the serial end never waits, few enough for memory.
constexpr std::size_t kScansPerThread = 2;

}  // namespace

void process_in_order(const std::vector<std::size_t>& indices, int threads,
                      const std::function<ProcessedScan(std::size_t)>& process,
                      const std::function<void(const ProcessedScan&)>& take,
                      const CancelFlag& cancel) {
  if (threads == 1) {
    for (const std::size_t index : indices) {
      if (cancel) throw Cancelled();
      take(process(index));
    }
    return;
  }
  using Shared = std::shared_ptr<const ProcessedScan>;
  std::size_t next = 0;
  const auto source = [&](tbb::flow_control& control) -> std::size_t {
    if (cancel) throw Cancelled();
    if (next == indices.size()) {
      control.stop();
      return 0;
    }
    return indices[next++];
  };
  const auto middle = [&](std::size_t index) -> Shared {
    return std::make_shared<ProcessedScan>(process(index));
  };
  const auto sink = [&](const Shared& scan) { take(*scan); };
  tbb::task_arena arena(threads == 0 ? tbb::task_arena::automatic : threads);
  arena.execute([&] {
    using tbb::filter_mode;
    const auto tokens = kScansPerThread * static_cast<std::size_t>(arena.max_concurrency());
    tbb::parallel_pipeline(
        tokens, tbb::make_filter<void, std::size_t>(filter_mode::serial_in_order, source) &
                    tbb::make_filter<std::size_t, Shared>(filter_mode::parallel, middle) &
                    tbb::make_filter<Shared, void>(filter_mode::serial_in_order, sink));
  });
}

}  // namespace stillmap::mapping
