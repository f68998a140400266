#include "errors/upload_errors.hpp"

#include <gmock/gmock.h>

namespace stillmap::server {
namespace upload_errors_test {

TEST(UploadErrors, MessagesNameNoPlaceOfTheStore) {
  const auto shown = [](const std::string& text) { return without_folder(text, "/srv/maps"); };
  EXPECT_EQ(shown("/srv/maps/drives/12/drive-12/scans/1.bin: found 3 bytes"),
            "scans/1.bin: found 3 bytes");
  EXPECT_EQ(shown("/srv/maps/drives/12/.incoming-drive/1.bin"), "1.bin");
  EXPECT_EQ(shown("/srv/maps/drives/7/parts/2: cut"), "2: cut");
  EXPECT_EQ(
      shown("/srv/maps/drives/7/.incoming-drive: as in '/srv/maps/drives/7/drive-7?cloud=/a'"),
      "drive 7: as in 'drive 7?cloud=/a'");
  EXPECT_EQ(shown("/srv/maps/drives/7/drive-77: no"), "drives/7/drive-77: no");
  EXPECT_EQ(shown("/srv/maps/jobs/3/scratch/work/cut.pcd and /srv/maps/jobs/3/scratch/map"),
            "work/cut.pcd and map");
  EXPECT_EQ(shown("/srv/maps/packages/.incoming-77-0/objects.json: x"), "objects.json: x");
  EXPECT_EQ(shown("/srv/maps/packages/.incoming-77-0/town/objects.json"), "town/objects.json");
  EXPECT_EQ(shown("/srv/maps/state.db: no"), "state.db: no");
  // What is not a place of the store is the client's own.
  EXPECT_EQ(shown("drives/12/drive-12/a"), "drives/12/drive-12/a");
  EXPECT_EQ(shown("/srv/maps/drives/x/drive-12/a"), "drives/x/drive-12/a");
  EXPECT_EQ(shown("/srv/maps/drives/12/drive-x/a"), "drives/12/drive-x/a");
  EXPECT_EQ(shown("/srv/maps/drives/12"), "drives/12");
  EXPECT_EQ(shown("/srv/maps/packages/.incoming-77"), "packages/.incoming-77");
  EXPECT_EQ(shown("/srv/maps/"), "");
}

}  // namespace upload_errors_test
}  // namespace stillmap::server
