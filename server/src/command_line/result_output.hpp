#pragma once

#include <CLI/CLI.hpp>

#include <filesystem>
#include <string>

namespace stillmap::command_line {

/// `--json` of every command that has a result: `--json` prints it as one JSON object on standard
/// output in place of the text for people, `--json=FILE` writes it to FILE beside that text.
class JsonOutput {
 public:
  void add_to(CLI::App& command);
  [[nodiscard]] bool is_asked() const { return !given_.empty(); }
  /// Standard output holds the object and nothing else.
  [[nodiscard]] bool replaces_text() const { return given_ == kPrinted; }
  /// Empty unless there is one.
  [[nodiscard]] std::filesystem::path file() const;
  /// Prints or writes the object if it is asked for.
  /// @throws maps::StorageError.
  void write(const std::string& object) const;

 private:
  /// What CLI11 stores for a flag without a value.
  static constexpr const char* kPrinted = "true";
  std::string given_;
};

/// `--report FILE` of every command that can draw its result: one HTML page.
class ReportOutput {
 public:
  /// @return the option, for what it needs.
  CLI::Option* add_to(CLI::App& command);
  [[nodiscard]] bool is_asked() const { return !file_.empty(); }
  /// Writes the page and prints its path. @throws maps::StorageError.
  void write(const std::string& html, const JsonOutput& json) const;

 private:
  std::filesystem::path file_;
};

}  // namespace stillmap::command_line
