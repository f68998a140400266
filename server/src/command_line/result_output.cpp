#include "command_line/result_output.hpp"

#include <fmt/core.h>

#include <cstdio>

#include "command_line/run_program.hpp"
#include "command_line/text_file.hpp"

namespace stillmap::command_line {

void JsonOutput::add_to(CLI::App& command) {
  command
      .add_flag("--json", given_,
                "Print the result as one JSON object instead of text; --json=FILE writes it to "
                "FILE and still prints the text")
      ->option_text("[=FILE]")
      ->check(CLI::Validator(
          [](const std::string& given) {
            return given == kPrinted ? std::string() : in_existing_folder()(given);
          },
          ""));
}

std::filesystem::path JsonOutput::file() const {
  return is_asked() && !replaces_text() ? std::filesystem::path(given_) : std::filesystem::path();
}

void JsonOutput::write(const std::string& object) const {
  if (!is_asked()) return;
  const std::string text = object.ends_with('\n') ? object : object + "\n";
  if (replaces_text())
    fmt::print("{}", text);
  else
    write_text_file(file(), text);
}

CLI::Option* ReportOutput::add_to(CLI::App& command) {
  return command
      .add_option("--report", file_,
                  "Write a report with pictures to FILE, one HTML page, and print its path")
      ->check(in_existing_folder());
}

void ReportOutput::write(const std::string& html, const JsonOutput& json) const {
  if (!is_asked()) return;
  write_text_file(file_, html);
  // The object on standard output stays alone there.
  fmt::print(json.replaces_text() ? stderr : stdout, "report: {}\n", file_.string());
}

}  // namespace stillmap::command_line
