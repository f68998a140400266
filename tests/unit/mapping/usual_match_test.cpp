#include "odometry/direct/usual_match.hpp"
#include "odometry/direct/seen_again.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace stillmap::mapping {
namespace usual_match_test {

localization::LocalAlignment match_of(double known, double standing, double fit) {
  localization::LocalAlignment match;
  match.matched = localization::LocalAlignment::kMinMatched;
  match.known_inlier_ratio = known;
  match.standing_ratio = standing;
  match.fit = fit;
  match.inlier_ratio = known;
  return match;
}

TEST(UsualMatch, DoubtsWhatExplainsLessThanUsualOnceItKnowsWhatThatIs) {
  UsualMatch usual;
  const auto poor = match_of(0.5, 0.5, 0.1);
  for (int i = 0; i < 3; ++i) {
    EXPECT_TRUE(usual.is_likely(poor)) << i;
    usual.learn(match_of(0.95, 0.8, 0.7));
  }
  EXPECT_EQ(usual.matched(), 3U);
  EXPECT_TRUE(usual.on_surfaces());
  EXPECT_FALSE(usual.is_likely(poor)) << "too few points lie on the map";
  EXPECT_TRUE(usual.is_likely(match_of(0.7, 0.5, 0.6)));
  EXPECT_FALSE(usual.is_likely(match_of(0.7, 0.05, 0.3))) << "fit and standing points";
  EXPECT_TRUE(usual.is_likely(match_of(0.7, 0.05, 0.5))) << "it fits";
  EXPECT_TRUE(usual.explains(match_of(0.94, 0.75, 0.1)));
  EXPECT_FALSE(usual.explains(match_of(0.85, 0.75, 0.1)));
}

TEST(UsualMatch, DoesNotAskStandingPointsInOpenCountry) {
  UsualMatch usual;
  for (int i = 0; i < 3; ++i) usual.learn(match_of(0.95, 0.2, 0.7));
  EXPECT_TRUE(usual.is_likely(match_of(0.7, 0.01, 0.1)));
}

TEST(SeenAgain, IsTheShareOfWhatIsNearAndWasSeen) {
  std::vector<Eigen::Vector3f> wall, shell, few;
  for (int i = 0; i < 200; ++i) {
    const float along = 0.1F * static_cast<float>(i) - 10.0F;
    wall.emplace_back(8.0F, along, 1.0F);
    shell.push_back(Eigen::Vector3f(8.0F, along, 1.0F).normalized() * 2.0F);
    if (i < 20) few.emplace_back(8.0F, along, 1.0F);
  }
  const Eigen::Isometry3d here = Eigen::Isometry3d::Identity();
  SeenAgain seen;
  EXPECT_FALSE(seen.share(wall, here)) << "nothing was seen yet";
  seen.remember(few, here);
  EXPECT_FALSE(seen.share(wall, here)) << "too little to tell";
  seen.remember(wall, here);
  EXPECT_DOUBLE_EQ(seen.share(wall, here).value(), 1.0);
  EXPECT_DOUBLE_EQ(seen.share(shell, here).value(), 0.0);
  Eigen::Isometry3d beside = here;
  beside.translation().y() = 10.0;
  EXPECT_NEAR(seen.share(wall, beside).value(), 0.5, 0.1);
}

}  // namespace usual_match_test
}  // namespace stillmap::mapping
