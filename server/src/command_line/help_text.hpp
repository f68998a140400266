#pragma once

#include <CLI/CLI.hpp>

#include <string>

namespace stillmap::command_line {

/// Help of one command: usage, description, arguments, options, commands below it. Lines of text
/// end before column 100.
class HelpText final : public CLI::FormatterBase {
 public:
  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override;
};

}  // namespace stillmap::command_line
