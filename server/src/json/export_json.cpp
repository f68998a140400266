#include "json/export_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {

std::string export_json(const std::string& format, const maps::MapExportReport& report) {
  return to_text(Json{{"format", format},
                      {"points", report.points},
                      {"files", report.files},
                      {"bytes", report.bytes}},
                 2);
}

}  // namespace stillmap::server
