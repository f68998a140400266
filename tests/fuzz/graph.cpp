// Key frames and loops of a package of four poses.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_graph.hpp>

#include <stillmap/maps/package_files.hpp>

namespace {

using namespace stillmap;

std::shared_ptr<const maps::MapPackage> package_of(std::string_view graph) {
  static const std::string kPoses =
      "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 2 0 0 0 0 0 1\n3 3 0 0 0 0 0 1\n";
  maps::MapManifest manifest;
  const auto list = [&](const std::string& path, std::string_view content) {
    fuzz::put(path, content);
    manifest.files[path] = {.bytes = content.size(), .sha256 = std::string(64, '0')};
  };
  list(maps::trajectory_path(0), kPoses);
  list(maps::kGraphName, graph);
  fuzz::put(maps::kManifestName, maps::manifest_text(manifest));
  return maps::MapPackage::open(fuzz::folder().path());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto package = package_of(fuzz::text_of(data, size));
  const auto graph =
      fuzz::taken<maps::InputError>([&] { return maps::read_map_graph(*package).value(); });
  if (!graph) return 0;
  for (std::size_t i = 0; i < graph->key_frames.size(); ++i) {
    fuzz::require(graph->key_frames[i] < 4, "poses of the map");
    fuzz::require(i == 0 || graph->key_frames[i] > graph->key_frames[i - 1], "they ascend");
  }
  for (const maps::MapGraph::Loop& loop : graph->loops) {
    fuzz::require(loop.from < 4 && loop.to < 4, "poses of the map");
    fuzz::require(loop.weight >= 0.0 && loop.weight <= 1.0, "a weight in [0, 1]");
  }
  return 0;
}
