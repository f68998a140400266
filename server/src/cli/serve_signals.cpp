#include "serve_signals.hpp"

#include <pthread.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "command_line/run_program.hpp"

namespace stillmap::cli {
namespace {

using Clock = std::chrono::steady_clock;

/// Sent by this process to its own thread alone.
constexpr int kEnded = SIGUSR1;

sigset_t all_signals() {
  sigset_t signals{};
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, kEnded}) sigaddset(&signals, signal);
  return signals;
}

timespec time_until(Clock::time_point end) {
  const auto left = std::max(Clock::duration::zero(), end - Clock::now());
  const auto seconds = std::chrono::floor<std::chrono::seconds>(left);
  return {.tv_sec = seconds.count(), .tv_nsec = std::chrono::nanoseconds(left - seconds).count()};
}

}  // namespace

void SignalLoop::block() {
  const sigset_t signals = all_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
}

SignalLoop::SignalLoop(SignalActions actions) : actions_(std::move(actions)) {
  thread_ = std::thread([this] { run(); });
}

SignalLoop::~SignalLoop() {
  pthread_kill(thread_.native_handle(), kEnded);
  thread_.join();
}

bool SignalLoop::wait(std::chrono::seconds time) {
  const sigset_t signals = all_signals();
  const Clock::time_point end = Clock::now() + time;
  while (Clock::now() < end) {
    const timespec left = time_until(end);
    const int signal = sigtimedwait(&signals, nullptr, &left);
    if (signal == kEnded) return false;
    if (signal != SIGTERM && signal != SIGINT) continue;
    spdlog::warn("stopping at once after a second signal");
    std::_Exit(exit_code::kCancelled);
  }
  return true;
}

void SignalLoop::run() {
  const sigset_t signals = all_signals();
  int signal = 0;
  do {
    sigwait(&signals, &signal);
    if (signal == SIGHUP) actions_.reload();
  } while (signal == SIGHUP);
  if (signal == kEnded) return;
  const std::chrono::seconds most = actions_.drain();
  if (!wait(most)) return;
  spdlog::warn("stopping although work is still in hand, after {} s", most.count());
  std::_Exit(exit_code::kSucceeded);
}

}  // namespace stillmap::cli
