// From scans to a pose over HTTP: simulated drive -> map package -> store -> server -> answers for
// scans that the map has not seen.
#include <gmock/gmock.h>

#include <stillmap/mapping/map_build.hpp>
#include <stillmap/maps/drive.hpp>
#include <stillmap/server/server.hpp>
#include <stillmap/simulation/simulate.hpp>
#include "store/package_store.hpp"

#include <chrono>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "support/matchers.hpp"
#include "support/temporary_folder.hpp"

// After what brings in Eigen, whose headers its macros break.
#include <httplib.h>

namespace stillmap {
namespace {

Eigen::Isometry3d pose_of(const nlohmann::json& pose) {
  const auto p = pose.at("position").get<std::array<double, 3>>();
  const auto q = pose.at("quaternion").get<std::array<double, 4>>();
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(p[0], p[1], p[2]);
  T.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).toRotationMatrix();
  return T;
}

class PoseOverHttp : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::TemporaryFolder();
    const mapping::CancelFlag cancel = false;
    simulation::SimulationOptions simulation;
    simulation.sensor = "vlp16";
    simulation.scans = 24;
    simulation::simulate_drive(folder_->path() / "drive", simulation, {}, cancel);
    std::filesystem::create_directory(folder_->path() / "store");
    mapping::MapBuildOptions build;
    build.selection = maps::Selection::parse("::2");
    mapping::build_map({folder_->path() / "drive"}, folder_->path() / "map", build, {}, cancel);
    server::PackageStore store(folder_->path() / "store");
    store.add("town", "v1", folder_->path() / "map");
    store.activate("town", "v1");
  }
  static void TearDownTestSuite() { delete folder_; }

  void SetUp() override {
    server::ServerOptions options;
    options.port = 0;
    server_ = std::make_unique<server::Server>(options, folder_->path() / "store",
                                               folder_->path() / "no_web");
    port_ = server_->bind();
    thread_ = std::thread([this] { server_->run(); });
    while (client().Get("/readyz")->status != 200)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  void TearDown() override {
    server_->stop();
    thread_.join();
  }

  httplib::Client client() const { return httplib::Client("127.0.0.1", port_); }

  nlohmann::json localize(const maps::PointCloud& scan,
                          const Eigen::Isometry3d& T_map_prior) const {
    std::string body(scan.size() * sizeof(Eigen::Vector3f), '\0');
    std::memcpy(body.data(), scan.positions.data(), body.size());
    const Eigen::Quaterniond q(T_map_prior.linear());
    nlohmann::json request;
    request["layout"] = "xyz";
    const Eigen::Vector3d t = T_map_prior.translation();
    request["prior"] = {{"position", {t.x(), t.y(), t.z()}},
                        {"quaternion", {q.x(), q.y(), q.z(), q.w()}}};
    const httplib::MultipartFormDataItems parts = {
        {"request", request.dump(), "", "application/json"},
        {"scan", body, "scan.bin", "application/octet-stream"}};
    auto response = client().Post("/v1/maps/town/localize", parts);
    EXPECT_TRUE(response);
    EXPECT_EQ(response->status, 200) << response->body;
    return nlohmann::json::parse(response->body);
  }

  static test::TemporaryFolder* folder_;
  std::unique_ptr<server::Server> server_;
  int port_ = 0;
  std::thread thread_;
};
test::TemporaryFolder* PoseOverHttp::folder_ = nullptr;

TEST_F(PoseOverHttp, HeldBackScansAreFoundFromAWrongPrior) {
  const maps::Drive drive = maps::Drive::open(folder_->path() / "drive");
  for (const std::size_t index : {5U, 11U, 17U}) {
    Eigen::Isometry3d T_map_prior = drive.T_map_lidar(index);
    T_map_prior.translation() += Eigen::Vector3d(0.6, -0.8, 0.1);
    T_map_prior.linear() =
        T_map_prior.linear() * Eigen::AngleAxisd(0.087, Eigen::Vector3d::UnitZ());
    const nlohmann::json answer = localize(drive.read(index).cloud, T_map_prior);
    ASSERT_EQ(answer["status"], "ok") << answer;
    // The project's bar for a pose: 0.2 m and 1 deg.
    EXPECT_THAT(pose_of(answer["pose"]), test::IsNearPose(drive.T_map_lidar(index), 0.2, 0.0175))
        << index;
    EXPECT_NEAR(answer["prior_to_pose"]["m"].get<double>(), 1.0, 0.25);
  }
}

TEST_F(PoseOverHttp, ScanFromElsewhereIsNeverSaidToBeOk) {
  // A flat disc far above the street: nothing of it is in the map.
  maps::PointCloud elsewhere;
  for (int i = 0; i < 5000; ++i) {
    const float angle = 0.1F * static_cast<float>(i);
    const float radius = 2.0F + 0.005F * static_cast<float>(i);
    elsewhere.positions.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 40.0F);
  }
  const maps::Drive drive = maps::Drive::open(folder_->path() / "drive");
  EXPECT_NE(localize(elsewhere, drive.T_map_lidar(5))["status"], "ok");
}

TEST_F(PoseOverHttp, EveryTileThatIsListedIsServed) {
  const nlohmann::json map = nlohmann::json::parse(client().Get("/v1/maps/town")->body);
  const std::string list = "/v1/maps/town/versions/" + map["version"].get<std::string>() + "/tiles";
  const nlohmann::json tiles =
      nlohmann::json::parse(client().Get(list + "?limit=1000")->body)["tiles"];
  EXPECT_EQ(map["tiles"], tiles.size());
  ASSERT_FALSE(tiles.empty());
  for (const nlohmann::json& tile : tiles) {
    const std::string path =
        list + "/" + tile["level"].dump() + "/" + tile["x"].dump() + "/" + tile["y"].dump();
    auto response = client().Get(path);
    ASSERT_EQ(response->status, 200) << path;
    const auto count = tile["points"].get<std::size_t>();
    ASSERT_EQ(response->body.size(), 20 * count) << path;
    // Added to the points it gives the map frame, where the map says that they lie.
    Eigen::Vector3d corner;
    ASSERT_EQ(std::sscanf(response->get_header_value("Stillmap-Tile-Corner").c_str(),
                          "%lf, %lf, %lf", &corner.x(), &corner.y(), &corner.z()),
              3);
    Eigen::AlignedBox3d found;
    for (std::size_t i = 0; i < count; ++i) {
      Eigen::Vector3f p;
      std::memcpy(p.data(), response->body.data() + 20 * i, sizeof(float) * 3);
      found.extend(corner + p.cast<double>());
    }
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      const auto number = static_cast<std::size_t>(axis);
      const double origin = map["origin"][number].get<double>();
      EXPECT_NEAR(found.min()[axis], origin + tile["min"][number].get<double>(), 1e-5) << path;
      EXPECT_NEAR(found.max()[axis], origin + tile["max"][number].get<double>(), 1e-5) << path;
    }
  }
}

}  // namespace
}  // namespace stillmap
