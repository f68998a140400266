#include <stillmap/server/options_holder.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <stdexcept>

namespace stillmap::server {
namespace {

std::shared_ptr<const ServerOptions> checked(const ServerOptions& options) {
  const std::vector<std::string> broken = options.violations();
  if (!broken.empty()) throw std::invalid_argument(fmt::format("{}", fmt::join(broken, "; ")));
  return std::make_shared<const ServerOptions>(options);
}

}  // namespace

OptionsHolder::OptionsHolder(const ServerOptions& options) : options_(checked(options)) {}

std::shared_ptr<const ServerOptions> OptionsHolder::current() const {
  const std::lock_guard lock(mutex_);
  return options_;
}

void OptionsHolder::replace(const ServerOptions& options) {
  std::shared_ptr<const ServerOptions> next = checked(options);
  const std::lock_guard lock(mutex_);
  options_.swap(next);
}

}  // namespace stillmap::server
