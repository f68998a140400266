#pragma once

#include "http/http_message.hpp"
#include "security/gatekeeper.hpp"

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <utility>

namespace stillmap::server {

/// Events for as long as the key that asked for them is good: a stream may outlive its key by days.
class GuardedEvents final : public EventSource {
 public:
  /// @param gatekeeper  outlives this.
  GuardedEvents(std::shared_ptr<EventSource> events, Gatekeeper& gatekeeper,
                std::string authorization, Access access)
      : events_(std::move(events)),
        gatekeeper_(gatekeeper),
        authorization_(std::move(authorization)),
        access_(access) {}

  /// Ends without a word: whoever asks again is told why.
  std::optional<std::string> next(std::chrono::milliseconds most) override {
    if (!gatekeeper_.still_admits(authorization_, access_)) return std::nullopt;
    return events_->next(most);
  }

 private:
  std::shared_ptr<EventSource> events_;
  Gatekeeper& gatekeeper_;
  std::string authorization_;
  Access access_;
};

}  // namespace stillmap::server
