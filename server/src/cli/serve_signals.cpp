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

timespec time_until(Clock::time_point end) {
  const auto left = std::max(Clock::duration::zero(), end - Clock::now());
  const auto seconds = std::chrono::floor<std::chrono::seconds>(left);
  return {.tv_sec = seconds.count(), .tv_nsec = std::chrono::nanoseconds(left - seconds).count()};
}

}  // namespace

SignalLoop::SignalLoop() {
  sigemptyset(&signals_);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, kEnded}) sigaddset(&signals_, signal);
  pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
}

SignalLoop::~SignalLoop() {
  if (!thread_.joinable()) return;
  pthread_kill(thread_.native_handle(), kEnded);
  thread_.join();
}

void SignalLoop::start(SignalActions actions) {
  actions_ = std::move(actions);
  thread_ = std::thread([this] { run(); });
}

bool SignalLoop::wait(std::chrono::seconds time) {
  const Clock::time_point end = Clock::now() + time;
  while (Clock::now() < end) {
    const timespec left = time_until(end);
    const int signal = sigtimedwait(&signals_, nullptr, &left);
    if (signal == kEnded) return false;
    if (signal != SIGTERM && signal != SIGINT) continue;
    spdlog::warn("stopping at once, as asked a second time");
    std::_Exit(command_line::kCancelled);
  }
  return true;
}

void SignalLoop::run() {
  int signal = 0;
  do {
    sigwait(&signals_, &signal);
    if (signal == SIGHUP) actions_.reload();
  } while (signal == SIGHUP);
  if (signal == kEnded) return;
  const std::chrono::seconds delay = actions_.drain();
  if (!wait(delay)) return;
  const std::chrono::seconds rest = actions_.stop();
  if (!wait(rest)) return;
  spdlog::warn("stopping although requests are still in hand, after {} s", rest.count());
  std::_Exit(command_line::kSucceeded);
}

}  // namespace stillmap::cli
