#include "evaluation/report/report_page.hpp"

#include "evaluation/report/style.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <utility>

namespace stillmap::mapping {

ReportPage::ReportPage(std::string_view title, std::string_view style)
    : html_(fmt::format("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
                        "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
                        "<title>{}</title><style>{}{}</style></head><body>\n",
                        title, kReportStyle, style)),
      title_(title) {}

void ReportPage::add_title(const std::string& facts) {
  html_ += fmt::format("<h1>{}</h1>\n<div class=\"facts\">{} · stillmap {}</div>\n", title_, facts,
                       STILLMAP_VERSION);
}

void ReportPage::add_command(const std::string& command) {
  html_ += "<h2>Command</h2>\n<pre>" + escaped(command) + "</pre>\n";
}

std::string ReportPage::finished() {
  html_ += "</body></html>\n";
  return std::move(html_);
}

}  // namespace stillmap::mapping
