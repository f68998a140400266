// JSON of requests that ask for no pose. The first byte says of which, the rest is the text.
#include "bodies/drives_json.hpp"
#include "bodies/keys_request_json.hpp"
#include "bodies/pose_request_json.hpp"
#include "bodies/tile_diff_json.hpp"
#include "jobs/job_request.hpp"
#include "pose_rules.hpp"

#include "store/map_name.hpp"

#include <algorithm>
#include <set>

namespace {

using namespace stillmap;

bool is_printed(std::string_view text) {
  return std::none_of(text.begin(), text.end(),
                      [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

void read_key(std::string_view text) {
  const auto key = fuzz::taken<server::ApiError>([&] { return server::read_key_request(text); });
  if (!key) return;
  fuzz::require(!key->name.empty() && key->name.size() <= 100 && is_printed(key->name), "a name");
  const auto& all = server::all_key_scopes();
  fuzz::require(
      std::any_of(all.begin(), all.end(), [&](auto scope) { return key->scopes.has(scope); }),
      "a key is allowed something");
  if (key->expires_days)
    fuzz::require(*key->expires_days >= 1 && *key->expires_days <= 36'500, "at most a century");
}

void read_rebuild(std::string_view text) {
  const auto asked =
      fuzz::taken<server::ApiError>([&] { return server::read_rebuild_request(text); });
  if (!asked) return;
  fuzz::require(!asked->drives.empty() && asked->drives.size() <= 100, "1 to 100 drives");
  std::set<std::int64_t> drives(asked->drives.begin(), asked->drives.end());
  fuzz::require(*drives.begin() >= 1 && drives.size() == asked->drives.size(), "each drive once");
  if (asked->held_back) fuzz::require(drives.insert(*asked->held_back).second, "held back");
  fuzz::require(asked->version.empty() || server::is_valid_map_name(asked->version), "a version");
  static_cast<void>(server::takes_saved_edits(*asked));
  const std::string shown = server::to_json(*asked);
  fuzz::require(server::to_json(server::read_rebuild_request(shown)) == shown, "shown as asked");
  const std::string kept = server::to_stored_json(*asked);
  const server::RebuildRequest again = server::read_stored_rebuild(kept);
  fuzz::require(again.drives == asked->drives && again.held_back == asked->held_back &&
                    again.options == asked->options && again.edits == asked->edits &&
                    again.version == asked->version && again.activate == asked->activate &&
                    again.new_frame == asked->new_frame,
                "kept as asked");
}

void read_drive(std::string_view text) {
  const auto name = fuzz::taken<server::ApiError>([&] { return server::read_drive_json(text); });
  if (name) fuzz::require(name->size() <= 200 && is_printed(*name), "a name");
}

void read_upload(std::string_view text) {
  const auto upload = fuzz::taken<server::ApiError>([&] { return server::read_upload_json(text); });
  if (!upload) return;
  fuzz::require(server::is_valid_map_name(upload->version), "a version");
  fuzz::require(!upload->content_type.empty(), "a media type");
}

void read_tile_diff(std::string_view text) {
  const auto diff = fuzz::taken<server::ApiError>(
      [&] { return server::read_tile_diff_json(text, fuzz::small_options()); });
  if (!diff) return;
  fuzz::require(diff->centre_map.cwiseAbs().maxCoeff() <= 1e8, "a centre that is near enough");
  fuzz::require(diff->level <= server::kMaxDiffLevel, "a level");
  fuzz::require(diff->cached_ids.size() <= server::kMaxCachedIds, "no more ids than allowed");
  fuzz::require(
      diff->radius_m > 0.0 &&
          diff->radius_m <=
              server::kMaxDiffWidths * std::ldexp(maps::kTileSizeM, static_cast<int>(diff->level)),
      "a radius of so many tiles");
}

void read_session(std::string_view text, bool opens) {
  const auto session = fuzz::taken<server::ApiError>(
      [&] { return server::read_session_json(text, opens, fuzz::small_options()); });
  if (!session) return;
  fuzz::require(session->label.size() <= 64 && is_printed(session->label), "a label");
  fuzz::require(!(session->prior && session->gnss), "one place");
  if (session->prior)
    fuzz::require(session->prior->covariance.has_value(), "a prior with its covariance");
  if (session->gnss)
    fuzz::require(std::abs(session->gnss->latitude_deg) <= 90.0 &&
                      std::abs(session->gnss->longitude_deg) <= 180.0,
                  "a place on the Earth");
  server::PoseParameters parameters;
  parameters.prior = session->prior;
  fuzz::require_bounds(parameters);
}

void read_batch(std::string_view text, server::JsonScan scan) {
  server::ServerOptions options = fuzz::small_options();
  options.batch.max_scans = 4;
  const auto batch =
      fuzz::taken<server::ApiError>([&] { return server::read_batch_json(text, scan, options); });
  if (!batch) return;
  fuzz::require(!batch->items.empty() && batch->items.size() <= 4, "no more queries than allowed");
  for (const server::JsonBatch::Item& item : batch->items)
    if (!item.error) fuzz::require_bounds(item.request.parameters);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view text = fuzz::text_of(data + 1, size - 1);
  switch (data[0] % 10) {
    case 0:
      read_key(text);
      break;
    case 1:
      read_rebuild(text);
      break;
    case 2:
      read_drive(text);
      break;
    case 3:
      read_upload(text);
      break;
    case 4:
      read_tile_diff(text);
      break;
    case 5:
      read_session(text, true);
      break;
    case 6:
      read_session(text, false);
      break;
    case 7:
      read_batch(text, server::JsonScan::kInside);
      break;
    case 8:
      read_batch(text, server::JsonScan::kRawBeside);
      break;
    default:
      read_batch(text, server::JsonScan::kPcdBeside);
  }
  return 0;
}
