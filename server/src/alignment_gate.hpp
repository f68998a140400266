#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>

namespace stillmap::server {

/// Lets a bounded number of alignments run and a bounded number wait, so that load turns into
/// refusals instead of ever longer answers. Safe from several threads.
class AlignmentGate {
 public:
  /// Leaves the gate when it goes.
  class Ticket {
   public:
    explicit Ticket(AlignmentGate& gate) : gate_(&gate) {}
    Ticket(Ticket&& other) noexcept : gate_(other.gate_) { other.gate_ = nullptr; }
    Ticket(const Ticket&) = delete;
    Ticket& operator=(const Ticket&) = delete;
    Ticket& operator=(Ticket&&) = delete;
    ~Ticket() {
      if (gate_ != nullptr) gate_->leave();
    }

   private:
    AlignmentGate* gate_;
  };

  /// @param workers  running at one time, >= 1.  @param queue  waiting at one time, >= 0.
  AlignmentGate(int workers, int queue) : free_(workers), places_(queue) {}

  /// Waits for a free worker, at most until `deadline`.
  /// @throws ApiError kBusy when the queue is full, kDeadlineExceeded when it got too late.
  [[nodiscard]] Ticket enter(std::optional<std::chrono::steady_clock::time_point> deadline);

 private:
  void leave();

  std::mutex mutex_;
  std::condition_variable freed_;
  int free_;
  int places_;
};

}  // namespace stillmap::server
