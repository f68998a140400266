#pragma once

#include "pose/session.hpp"

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace stillmap::server {

/// One session as whoever opened it sees it.
[[nodiscard]] std::string session_json(const Session& session, std::chrono::seconds idle_limit);
/// Sessions and who is told of them.
struct SessionList {
  std::vector<std::shared_ptr<Session>> sessions{};
  /// Is told the secrets of its own alone.
  std::string caller{};
  /// By key id.
  std::map<std::string, std::string> key_names{};
};
/// `{"sessions": [...]}`.
[[nodiscard]] std::string session_list_json(const SessionList& list,
                                            std::chrono::seconds idle_limit);

}  // namespace stillmap::server
