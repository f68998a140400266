#include "machine_use.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <string>
#include <thread>

#include "server_process.hpp"

namespace stillmap::bench {
namespace {

double seconds_of(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

double own_cpu_s() {
  rusage use{};
  ::getrusage(RUSAGE_SELF, &use);
  return seconds_of(use.ru_utime) + seconds_of(use.ru_stime);
}

}  // namespace

OthersUse::OthersUse(const ServerProcess& server) : server_(server), begin_(now()) {}

std::optional<OthersUse::Cpu> OthersUse::now() const {
  std::ifstream file("/proc/stat");
  std::string name;
  // user nice system idle iowait irq softirq steal, in ticks (proc(5)).
  std::array<double, 8> ticks{};
  file >> name;
  for (double& each : ticks) file >> each;
  if (!file) return std::nullopt;
  unsigned cores = 0;
  for (std::string line; std::getline(file, line);) cores += line.starts_with("cpu") ? 1 : 0;
  if (cores != std::thread::hardware_concurrency()) return std::nullopt;
  const auto per_s = static_cast<double>(::sysconf(_SC_CLK_TCK));
  Cpu cpu;
  for (const double each : ticks) cpu.all_s += each / per_s;
  cpu.busy_s = cpu.all_s - (ticks[3] + ticks[4]) / per_s;
  cpu.ours_s = own_cpu_s() + server_.cpu_s();
  return cpu;
}

std::optional<double> OthersUse::share() const {
  const std::optional<Cpu> end = now();
  if (!begin_ || !end || end->all_s <= begin_->all_s) return std::nullopt;
  const double others_s = end->busy_s - begin_->busy_s - (end->ours_s - begin_->ours_s);
  return std::max(0.0, others_s) / (end->all_s - begin_->all_s);
}

}  // namespace stillmap::bench
