#include "http/connection_threads.hpp"

#include <chrono>
#include <utility>

namespace stillmap::server {

ConnectionThreads::~ConnectionThreads() { finish(); }

bool ConnectionThreads::offer(int socket) {
  const std::lock_guard lock(mutex_);
  join_ended();
  if (finishing_ || threads_ - idle_ + sockets_.size() >= most_) return false;
  if (idle_ <= sockets_.size() && !start_thread()) return false;
  sockets_.push_back(socket);
  offered_.notify_one();
  return true;
}

std::size_t ConnectionThreads::busy() const {
  const std::lock_guard lock(mutex_);
  return threads_ - idle_ + sockets_.size();
}

bool ConnectionThreads::start_thread() {
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, kStackBytes);
  pthread_t thread{};
  const bool made = pthread_create(&thread, &attributes, enter, this) == 0;
  pthread_attr_destroy(&attributes);
  // A new thread counts as idle: it will take what is offered.
  threads_ += made ? 1 : 0;
  idle_ += made ? 1 : 0;
  return made;
}

void* ConnectionThreads::enter(void* self) {
  static_cast<ConnectionThreads*>(self)->work();
  return nullptr;
}

void ConnectionThreads::work() {
  constexpr std::chrono::seconds kPatience(5);
  std::unique_lock lock(mutex_);
  while (offered_.wait_for(lock, kPatience, [&] { return finishing_ || !sockets_.empty(); }) &&
         !sockets_.empty()) {
    const int socket = sockets_.front();
    sockets_.pop_front();
    --idle_;
    lock.unlock();
    serve_(socket);
    lock.lock();
    ++idle_;
  }
  --idle_;
  --threads_;
  ended_.push_back(pthread_self());
  ended_changed_.notify_all();
}

void ConnectionThreads::join_ended() {
  for (const pthread_t thread : std::exchange(ended_, {})) pthread_join(thread, nullptr);
}

void ConnectionThreads::finish() {
  std::unique_lock lock(mutex_);
  finishing_ = true;
  offered_.notify_all();
  ended_changed_.wait(lock, [&] { return threads_ == 0; });
  const std::vector<pthread_t> ended = std::exchange(ended_, {});
  lock.unlock();
  for (const pthread_t thread : ended) pthread_join(thread, nullptr);
}

}  // namespace stillmap::server
