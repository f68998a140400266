#include "derived/derived_worker.hpp"

#include <spdlog/spdlog.h>

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <new>
#include <utility>

namespace stillmap::server {
namespace {

/// Of this thread alone, as Linux has it.
void become_least_urgent() {
  constexpr int kLowest = 19;
  if (::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kLowest) != 0)
    spdlog::warn("derived files are made at the priority of everything else");
}

}  // namespace

DerivedWorker::DerivedWorker(std::chrono::milliseconds pause)
    : pause_(pause), thread_([this](const std::stop_token& stop) { run(stop); }) {}

DerivedWorker::Answer DerivedWorker::ask(const std::string& key, Work work, Turn turn) {
  const std::scoped_lock lock(mutex_);
  if (making_ == key) return {.state = State::kMaking, .progress = progress_};
  if (waits(key)) return {.state = State::kMaking};
  const Clock::time_point now = Clock::now();
  std::erase_if(failures_, [&](const auto& each) { return now - each.second.when >= pause_; });
  if (const auto failed = failures_.find(key); failed != failures_.end())
    return {.state = State::kFailed, .failure = failed->second.why};
  Waiting& waiting = waiting_.at(static_cast<std::size_t>(turn));
  if (waiting.size() >= (turn == Turn::kFirst ? kMostWaiting : kMostAfter))
    return {.state = State::kFull};
  waiting.emplace_back(key, std::move(work));
  changed_.notify_all();
  return {.state = State::kMaking};
}

/// Under the lock.
bool DerivedWorker::waits(const std::string& key) const {
  return std::any_of(waiting_.begin(), waiting_.end(), [&](const Waiting& waiting) {
    return std::any_of(waiting.begin(), waiting.end(),
                       [&](const auto& each) { return each.first == key; });
  });
}

/// Under the lock. Null when nothing waits.
DerivedWorker::Waiting* DerivedWorker::next_turn() {
  const auto found = std::find_if(waiting_.begin(), waiting_.end(),
                                  [](const Waiting& waiting) { return !waiting.empty(); });
  return found == waiting_.end() ? nullptr : &*found;
}

void DerivedWorker::run(const std::stop_token& stop) {
  become_least_urgent();
  while (true) {
    std::pair<std::string, Work> next;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, stop, [this] { return next_turn() != nullptr; });
      if (stop.stop_requested()) return;
      Waiting& waiting = *next_turn();
      next = std::move(waiting.front());
      waiting.pop_front();
      making_ = next.first;
      progress_ = 0.0;
    }
    make(next.first, next.second, stop);
  }
}

void DerivedWorker::make(const std::string& key, const Work& work, const std::stop_token& stop) {
  std::string failure;
  const auto note = [&](const char* why) noexcept {
    try {
      failure = why;
      spdlog::error("{}: {}", key, why);
    } catch (...) {
      // No memory for the words: it is made again when it is asked for again.
    }
  };
  try {
    work({.threads = 1, .go_on = [&](double share) {
            const std::scoped_lock lock(mutex_);
            progress_ = share;
            return !stop.stop_requested();
          }});
  } catch (const maps::WorkStopped&) {
  } catch (const std::exception& error) {
    note(error.what());
  } catch (...) {
    note("an unknown error");
  }
  const std::scoped_lock lock(mutex_);
  making_.clear();
  try {
    if (!failure.empty()) failures_.insert_or_assign(key, Failure{Clock::now(), failure});
  } catch (const std::bad_alloc&) {
    // As above.
  }
}

}  // namespace stillmap::server
