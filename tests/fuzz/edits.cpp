// Corrections of a map: as a file, and as a client sends them.
#include "fuzz_target.hpp"

#include <stillmap/maps/edits.hpp>
#include <stillmap/maps/error.hpp>

#include <cmath>

#include "errors/api_error.hpp"
#include "json/request_json.hpp"

namespace {

using namespace stillmap;

void require_bounds(const maps::Edits& edits) {
  for (const maps::Edit& edit : edits) {
    fuzz::require(edit.box.has_value() != edit.object.has_value(), "either a box or an object");
    if (edit.box) {
      fuzz::require(edit.box->centre.allFinite() && std::isfinite(edit.box->yaw_rad),
                    "a finite place");
      fuzz::require(edit.box->size_m.minCoeff() > 0.0 && edit.box->size_m.maxCoeff() <= 10'000.0,
                    "sizes above 0 and within 10 km");
      fuzz::require(edit.action == maps::EditAction::kKeep || edit.box->size_m.maxCoeff() <= 200.0,
                    "at most 200 m to remove");
    }
    if (edit.object) fuzz::require(edit.object->centre.allFinite(), "a finite place");
    if (const auto& scans = edit.scope.scans) {
      fuzz::require(edit.scope.drive.has_value(), "scans are those of a drive");
      fuzz::require(scans->first <= scans->second, "the last scan is not before the first");
    }
    fuzz::require(!edit.description().empty(), "a description");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text = fuzz::text_of(data, size);
  const auto edits =
      fuzz::taken<maps::InputError>([&] { return maps::parse_edits(text, "edits"); });
  if (edits) require_bounds(*edits);
  const auto json = fuzz::taken<server::ApiError>([&] {
    return server::parse_request_json(text,
                                      {.max_bytes = std::size_t{1} << 20U, .max_values = 300'000});
  });
  if (!json) return 0;
  // What the store keeps is read as what was sent.
  const std::string kept = json->dump();
  const auto again =
      fuzz::taken<maps::InputError>([&] { return maps::parse_edits(kept, "edits"); });
  if (!edits) return 0;
  fuzz::require(again && again->size() == edits->size(), "kept as it was sent");
  return 0;
}
