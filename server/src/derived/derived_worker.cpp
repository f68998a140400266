#include "derived/derived_worker.hpp"

#include <spdlog/spdlog.h>

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
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

DerivedWorker::Answer DerivedWorker::ask(const std::string& key, Work work) {
  const std::scoped_lock lock(mutex_);
  if (making_ == key) return {.state = State::kMaking, .progress = progress_};
  if (std::any_of(waiting_.begin(), waiting_.end(),
                  [&](const auto& each) { return each.first == key; }))
    return {.state = State::kMaking};
  const Clock::time_point now = Clock::now();
  std::erase_if(failures_, [&](const auto& each) { return now - each.second.when >= pause_; });
  if (const auto failed = failures_.find(key); failed != failures_.end())
    return {.state = State::kFailed, .failure = failed->second.why};
  if (waiting_.size() >= kMostWaiting) return {.state = State::kFull};
  waiting_.emplace_back(key, std::move(work));
  changed_.notify_all();
  return {.state = State::kMaking};
}

void DerivedWorker::run(const std::stop_token& stop) {
  become_least_urgent();
  while (true) {
    std::pair<std::string, Work> next;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, stop, [this] { return !waiting_.empty(); });
      if (stop.stop_requested()) return;
      next = std::move(waiting_.front());
      waiting_.pop_front();
      making_ = next.first;
      progress_ = 0.0;
    }
    make(next.first, next.second, stop);
  }
}

void DerivedWorker::make(const std::string& key, const Work& work, const std::stop_token& stop) {
  std::string failure;
  try {
    work({.threads = 1, .go_on = [&](double share) {
            const std::scoped_lock lock(mutex_);
            progress_ = share;
            return !stop.stop_requested();
          }});
  } catch (const maps::WorkStopped&) {
  } catch (const std::exception& error) {
    spdlog::error("{}: {}", key, error.what());
    failure = error.what();
  }
  const std::scoped_lock lock(mutex_);
  making_.clear();
  if (!failure.empty()) failures_.insert_or_assign(key, Failure{Clock::now(), failure});
}

}  // namespace stillmap::server
