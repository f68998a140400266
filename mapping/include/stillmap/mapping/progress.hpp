#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>

namespace stillmap::mapping {

/// Told of long work: stage, units done, units in all. Called from one thread at a time.
using ProgressCallback =
    std::function<void(std::string_view stage, std::size_t done, std::size_t total)>;

/// Set from a signal handler or another thread; long work ends at its next unit with `Cancelled`.
using CancelFlag = std::atomic<bool>;

struct Cancelled : std::runtime_error {
  Cancelled() : std::runtime_error("cancelled") {}
};

}  // namespace stillmap::mapping
