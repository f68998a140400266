#include <stillmap/mapping/localization_evaluation.hpp>

#include <fmt/format.h>

#include <cmath>
#include <iterator>

namespace stillmap::mapping {
namespace {

constexpr std::string_view kCsvColumns =
    "scan,trial,prior_error_m,prior_error_deg,status,reasons,"
    "error_x_m,error_y_m,error_z_m,error_roll_rad,error_pitch_rad,error_yaw_rad,"
    "level_longitudinal_m,level_lateral_m,level_vertical_m,level_yaw_rad,"
    "nees,inlier_ratio,cpu_ms,wall_ms\n";

void append_number(std::string& line, double value) {
  line += ',';
  // Nine digits: a nanometre in a metre, and what no reader of the table would miss.
  if (std::isfinite(value)) fmt::format_to(std::back_inserter(line), "{:.9g}", value);
}

void append_query(std::string& text, const LocalizationQuery& query) {
  fmt::format_to(std::back_inserter(text), "{},{}", query.scan, query.trial);
  append_number(text, query.prior_error.metres);
  append_number(text, query.prior_error.degrees);
  fmt::format_to(std::back_inserter(text), ",{},{}", localization::name_of(query.status),
                 fmt::join(localization::names_of(query.reasons), "|"));
  for (const double component : query.error) append_number(text, component);
  for (const double level : {query.protection.longitudinal_m, query.protection.lateral_m,
                             query.protection.vertical_m, query.protection.yaw_rad}) {
    append_number(text, level);
  }
  for (const double value : {query.nees, query.inlier_ratio, query.cpu_ms, query.wall_ms})
    append_number(text, value);
  text += '\n';
}

}  // namespace

std::string to_csv(const LocalizationEvaluation& evaluation) {
  std::string text(kCsvColumns);
  for (const std::vector<LocalizationQuery>& queries : evaluation.queries) {
    for (const LocalizationQuery& query : queries) append_query(text, query);
  }
  return text;
}

}  // namespace stillmap::mapping
