// Bytes as a configuration file: whatever they are, every problem has words of its own on one line, and what
// is left can be used.
#include "config/config_file.hpp"

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace stillmap::server;
  const ConfigText config =
      parse_config({reinterpret_cast<const char*>(bytes), size}, "configuration");
  ServerOptions options;
  for (const auto& [option, value] : config.values) {
    if (!option->set(options, value)) std::abort();
  }
  for (const ConfigProblem& problem : config.problems) {
    if (problem.text().find('\n') != std::string::npos) std::abort();
    if (problem.found.empty() || problem.expected.empty()) std::abort();
  }
  if (config.problems.empty()) static_cast<void>(broken_options(options));
  return 0;
}
