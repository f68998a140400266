#pragma once

#include <stillmap/maps/derived_file.hpp>

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>

namespace stillmap::server {

/// Makes what is derived from maps and kept beside them, one thing after the other, on one thread
/// of the lowest priority: whatever is asked for, poses do not wait for it. Safe from several
/// threads.
class DerivedWorker {
 public:
  using Clock = std::chrono::steady_clock;
  /// Ends early when `go_on` says so. What it throws is why it failed.
  using Work = std::function<void(const maps::DerivedWork&)>;

  /// What goes first: without the levels of a map nothing of it is seen, while the pairs of its
  /// versions that somebody may compare have no end.
  enum class Turn : std::uint8_t { kFirst, kAfter };
  /// Most that may wait of each turn; more are refused. Neither takes the other's places.
  static constexpr std::size_t kMostWaiting = 32;
  static constexpr std::size_t kMostAfter = 8;
  /// How long what failed is not tried again.
  static constexpr std::chrono::seconds kPause{60};

  enum class State : std::uint8_t {
    kMaking,  ///< it waits, or is under way
    kFailed,  ///< within the last minute
    kFull,    ///< too many others wait
  };
  struct Answer {
    State state = State::kMaking;
    /// Of one under way, in [0, 1].
    double progress = 0.0;
    /// Why it failed, in words of the work's own; empty otherwise.
    std::string failure{};
  };

  /// @param pause  as `kPause`.
  explicit DerivedWorker(std::chrono::milliseconds pause = kPause);
  DerivedWorker(const DerivedWorker&) = delete;
  DerivedWorker& operator=(const DerivedWorker&) = delete;
  /// Stops what is under way.
  ~DerivedWorker() = default;

  /// Has it made, unless that is under way or has just failed. Of those that wait the ones of
  /// `kFirst` go before the others, and what is under way goes on.
  /// @param key  names what is made: two works of one key make the same.
  Answer ask(const std::string& key, Work work, Turn turn = Turn::kFirst);

 private:
  struct Failure {
    Clock::time_point when;
    std::string why;
  };
  using Waiting = std::deque<std::pair<std::string, Work>>;
  [[nodiscard]] bool waits(const std::string& key) const;
  [[nodiscard]] Waiting* next_turn();
  void run(const std::stop_token& stop);
  void make(const std::string& key, const Work& work, const std::stop_token& stop);

  std::chrono::milliseconds pause_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  /// By turn.
  std::array<Waiting, 2> waiting_;
  /// Key of what is under way; empty = nothing.
  std::string making_;
  double progress_ = 0.0;
  std::map<std::string, Failure> failures_;
  std::jthread thread_;  // last: it uses all of the above
};

}  // namespace stillmap::server
