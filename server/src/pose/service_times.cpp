#include "pose/service_times.hpp"

#include <cmath>

namespace stillmap::server {

void ServiceTimes::add(WorkKind kind, double seconds) {
  if (!(seconds >= 0.0) || !std::isfinite(seconds)) return;
  Time& time = times_[index(kind)];
  if (!time.measured) {
    time = {.mean_s = seconds, .deviation_s = seconds / 2.0, .measured = true};
    return;
  }
  const double error = seconds - time.mean_s;
  time.mean_s += error / 8.0;
  time.deviation_s += (std::abs(error) - time.deviation_s) / 4.0;
}

}  // namespace stillmap::server
