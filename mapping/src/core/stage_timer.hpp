#pragma once

#include <chrono>
#include <map>
#include <string>

namespace stillmap::mapping {

using StageSeconds = std::map<std::string, double>;

/// Adds the time of a scope to a stage.
class StageTimer {
 public:
  StageTimer(StageSeconds& seconds, const char* stage)
      : seconds_(seconds[stage]), began_(std::chrono::steady_clock::now()) {}
  ~StageTimer() {
    seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count();
  }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  double& seconds_;
  std::chrono::steady_clock::time_point began_;
};

/// Adds counters or seconds of the same names.
template <typename Key, typename Number>
void add_to(std::map<Key, Number>& sums, const std::map<Key, Number>& more) {
  for (const auto& [name, number] : more) sums[name] += number;
}

}  // namespace stillmap::mapping
