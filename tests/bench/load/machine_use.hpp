#pragma once

#include <optional>

namespace stillmap::bench {

class ServerProcess;

/// How much of the machine others took while something was measured.
class OthersUse {
 public:
  /// Begins now. @param server  counts as ours; outlives this.
  explicit OthersUse(const ServerProcess& server);
  /// CPU time that neither this process nor the server took, as a share of all cores, since the
  /// beginning; a hypervisor's other guests count. Nothing where /proc tells of other cores than
  /// these, as in some containers.
  [[nodiscard]] std::optional<double> share() const;

 private:
  struct Cpu {
    double busy_s = 0.0;
    double all_s = 0.0;
    double ours_s = 0.0;
  };
  [[nodiscard]] std::optional<Cpu> now() const;

  const ServerProcess& server_;
  std::optional<Cpu> begin_;
};

}  // namespace stillmap::bench
