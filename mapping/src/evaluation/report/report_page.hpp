#pragma once

#include <string>
#include <string_view>

namespace stillmap::mapping {

/// The one way in which reports are made: a page of HTML that stands alone, with title, style sheet
/// and program version. A report derives from it and adds its parts to `html_`, in the order in
/// which they are read.
class ReportPage {
 protected:
  /// @param style rules of this report beside those that all have.
  explicit ReportPage(std::string_view title, std::string_view style = {});

  /// The title, and in one line what the report is about. @param facts HTML.
  void add_title(const std::string& facts);
  /// The command that made it. @param command plain text.
  void add_command(const std::string& command);
  /// The whole page. Once.
  [[nodiscard]] std::string finished();

  std::string html_;

 private:
  std::string title_;
};

}  // namespace stillmap::mapping
