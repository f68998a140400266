#pragma once

#include "pose/alignment_queue.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>

namespace stillmap::server {

/// Where the scans of one session stand in line: one is aligned, and of those that come meanwhile
/// only the newest waits, since a vehicle that sends faster than it is answered has no use for old
/// poses. Safe from several threads.
class SessionLine {
 public:
  using Clock = AlignmentQueue::Clock;

  /// @param queue  outlives this; scans of the session that wait in it are taken out of it.
  explicit SessionLine(AlignmentQueue& queue) : queue_(queue) {}
  SessionLine(const SessionLine&) = delete;
  SessionLine& operator=(const SessionLine&) = delete;

  /// One scan from its arrival to its answer.
  class Scan {
   public:
    /// Takes the place of the one that waits, which ends with kSuperseded.
    /// @throws ApiError kSuperseded when the one that waits is newer, kUnknownSession once closed.
    Scan(SessionLine& line, std::int64_t stamp_ns, Clock::time_point deadline);
    ~Scan();
    Scan(const Scan&) = delete;
    Scan& operator=(const Scan&) = delete;

    /// Waits until no scan of the session is being aligned.
    /// @throws ApiError kSuperseded, kDeadlineExceeded, kUnknownSession.
    void wait_for_turn();
    /// How it enters the queue of alignments.
    [[nodiscard]] AlignmentQueue::Work work(WorkKind kind);
    /// @throws ApiError kSuperseded, kUnknownSession when it has lost its place.
    void require_place() const;
    /// It has a worker: from now on nothing takes its place. @throws ApiError as above.
    void begin();

   private:
    friend class SessionLine;
    void check() const;

    SessionLine& line_;
    std::int64_t stamp_ns_;
    Clock::time_point deadline_;
    /// In the queue of alignments it inherits the place of the scan that it replaced, or a session
    /// whose every scan is replaced would start over for ever.
    Clock::time_point place_;
    AlignmentQueue::Cancel cancel_;
    /// In words; null while it has its place.
    const char* superseded_by_ = nullptr;
    bool begun_ = false;
  };

  /// While it lives no scan of the session is aligned.
  class Pause {
   public:
    /// Ends the waiting of the scan that waits with kSuperseded, and waits for the one that is
    /// being aligned.
    explicit Pause(SessionLine& line);
    ~Pause();
    Pause(const Pause&) = delete;
    Pause& operator=(const Pause&) = delete;

   private:
    SessionLine& line_;
  };

  /// Ends the waiting of the scan that waits; none is taken any more.
  void close();

 private:
  void supersede(const char* by);

  AlignmentQueue& queue_;
  std::mutex mutex_;
  std::condition_variable changed_;
  Scan* waiting_ = nullptr;
  bool aligning_ = false;
  int pauses_ = 0;
  bool closed_ = false;
};

}  // namespace stillmap::server
