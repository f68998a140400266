// Bytes as a configuration file: every problem stands on one line in words of its own, and what is
// taken is within its bounds.
#include "config/config_file.hpp"
#include "fuzz_target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace stillmap;
  const server::ConfigText config = server::parse_config(fuzz::text_of(data, size), "file");
  server::ServerOptions options;
  for (const auto& [option, value] : config.values) {
    fuzz::require(option->set(options, value), "a value that is taken is within its bounds");
  }
  for (const server::ConfigProblem& problem : config.problems) {
    fuzz::require(problem.text().find('\n') == std::string::npos, "a problem is one line");
    fuzz::require(!problem.found.empty() && !problem.expected.empty(), "a problem has words");
  }
  for (const server::BrokenOption& broken : server::broken_options(options)) {
    fuzz::require(!broken.other.empty(), "only what does not go together is left to break");
  }
  return 0;
}
