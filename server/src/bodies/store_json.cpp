#include "bodies/store_json.hpp"

#include "json/json_values.hpp"

namespace stillmap::server {
namespace {

constexpr int kIndent = 2;

Json key_of(const ApiKey& key) {
  Json scopes = Json::array();
  for (const KeyScope scope : all_key_scopes())
    if (key.scopes.has(scope)) scopes.push_back(name_of(scope));
  return {{"id", key.id},
          {"name", key.name},
          {"scopes", scopes},
          {"created_ns", time_of(key.created_ns)},
          {"expires_ns", time_of(key.expires_ns)},
          {"revoked_ns", time_of(key.revoked_ns)},
          {"maps", key.maps.empty() ? Json() : Json(key.maps)}};
}

Json package_of(const PackageOfVersions& package) {
  return {{"digest", package.digest}, {"versions", package.versions}, {"bytes", package.bytes}};
}

}  // namespace

std::string problems_json(const std::vector<StoreProblem>& problems) {
  Json list = Json::array();
  for (const auto& problem : problems)
    list.push_back({{"map", problem.map}, {"version", problem.version}, {"what", problem.what}});
  return to_text({{"problems", list}}, kIndent);
}

std::string cleared_json(const ClearedPackages& cleared,
                         const std::vector<RemovedVersion>& removed) {
  Json versions = Json::array();
  for (const RemovedVersion& each : removed)
    versions.push_back({{"map", each.map}, {"version", each.version}});
  Json json = {
      {"versions", versions}, {"packages", cleared.packages}, {"leftovers", cleared.leftovers}};
  if (cleared.blobs) json["blobs"] = *cleared.blobs;
  return to_text(json, kIndent);
}

std::string sent_json(std::size_t packages) { return to_text({{"packages", packages}}, kIndent); }

std::string removed_json(const RemovedVersion& removed, bool package_gone) {
  return to_text(
      {{"map", removed.map}, {"version", removed.version}, {"package_removed", package_gone}},
      kIndent);
}

std::string made_anew_json(const std::vector<MadeAnew>& all) {
  Json list = Json::array();
  for (const MadeAnew& made : all)
    list.push_back({{"digest", made.digest},
                    {"not_written_because", made.index_not_written_because},
                    {"levels_not_written_because", made.levels_not_written_because}});
  return to_text({{"indexes", list}}, kIndent);
}

std::string migration_plan_json(const MigrationPlan& plan, std::uint64_t free_bytes) {
  Json list = Json::array();
  for (const PackageOfVersions& package : plan.packages) list.push_back(package_of(package));
  return to_text({{"packages", list}, {"room_bytes", plan.room_bytes}, {"free_bytes", free_bytes}},
                 kIndent);
}

std::string migration_json(const Migration& migration) {
  Json migrated = Json::array();
  for (const MigratedPackage& each : migration.migrated)
    migrated.push_back(
        {{"former", package_of(each.former)}, {"digest", each.digest}, {"bytes", each.bytes}});
  Json left = Json::array();
  for (const PackageLeft& each : migration.left) {
    Json package = package_of(each.package);
    package["why"] = each.why;
    left.push_back(std::move(package));
  }
  return to_text({{"migrated", migrated}, {"left", left}}, kIndent);
}

std::string backup_json(const BackedUp& done) {
  return to_text({{"packages", {{"copied", done.copied}, {"kept", done.kept}}}}, kIndent);
}

std::string attached_json(const std::string& state) { return to_text({{"state", state}}, kIndent); }

std::string restored_json(std::size_t packages) {
  return to_text({{"packages", packages}}, kIndent);
}

std::string store_list_json(const std::vector<MapWithVersions>& maps, std::uint64_t bytes) {
  Json list = Json::array();
  for (const MapWithVersions& each : maps) {
    Json versions = Json::array();
    for (const StoredVersion& version : each.versions)
      versions.push_back({{"version", version.name},
                          {"active", version.name == each.map.active},
                          {"digest", version.digest},
                          {"former_digests", version.former_digests},
                          {"bytes", version.bytes},
                          {"created_ns", time_of(version.created_ns)}});
    list.push_back({{"name", each.map.name},
                    {"version", each.map.active ? Json(*each.map.active) : Json()},
                    {"previous_version", each.map.previous ? Json(*each.map.previous) : Json()},
                    {"revision", each.map.revision},
                    {"created_ns", time_of(each.map.created_ns)},
                    {"bytes", each.bytes},
                    {"versions", versions}});
  }
  return to_text({{"maps", list}, {"bytes", bytes}}, kIndent);
}

std::string added_json(const std::string& map, const PackageStore::Added& added) {
  return to_text({{"map", map},
                  {"version", added.version.name},
                  {"digest", added.version.digest},
                  {"bytes", added.version.bytes},
                  {"created_ns", time_of(added.version.created_ns)},
                  {"is_new", added.is_new}},
                 kIndent);
}

std::string created_key_json(const KeyTable::Created& created) {
  Json json = key_of(created.key);
  json["key"] = created.text;
  return to_text(json, kIndent);
}

std::string key_json(const ApiKey& key) { return to_text(key_of(key), kIndent); }

std::string keys_json(const std::vector<ApiKey>& keys) {
  Json list = Json::array();
  for (const ApiKey& key : keys) list.push_back(key_of(key));
  return to_text({{"keys", list}}, kIndent);
}

}  // namespace stillmap::server
