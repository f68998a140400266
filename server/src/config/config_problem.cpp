#include "config_problem.hpp"

#include <fmt/format.h>

#include "http/request_id.hpp"

namespace stillmap::server {

std::string ConfigProblem::text() const {
  const std::string where = name.empty() ? source : source + ": " + name;
  return printable(fmt::format("{}: found {}, expected {}", where, found, expected));
}

}  // namespace stillmap::server
