#include "blobs/s3_credentials.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <stillmap/maps/error.hpp>
#include <string>

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace s3_credentials_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;

class S3CredentialsTest : public testing::Test {
 protected:
  void write(const std::string& text, fs::perms mode = fs::perms::owner_read) {
    const fs::path half = folder_.write("half", text);
    fs::permissions(half, mode);
    fs::rename(half, file_);
  }
  test::TemporaryFolder folder_;
  fs::path file_ = folder_.path() / "credentials";
};

TEST_F(S3CredentialsTest, AFileIsReadAgainWhenItWasReplaced) {
  write("# for the maps\n[default]\naws_access_key_id = one\naws_secret_access_key=two=\n");
  S3CredentialsSource source(file_);
  EXPECT_EQ(source.current().access_key_id, "one");
  EXPECT_EQ(source.current().secret_access_key, "two=");
  EXPECT_EQ(source.current().session_token, "");
  write(
      "[other]\naws_access_key_id = wrong\n[default]\r\naws_access_key_id = three\r\n"
      "aws_secret_access_key = four\r\naws_session_token = five\r\n");
  EXPECT_EQ(source.current().access_key_id, "three");
  EXPECT_EQ(source.current().secret_access_key, "four");
  EXPECT_EQ(source.current().session_token, "five");
}

TEST_F(S3CredentialsTest, RefusesAFileThatOthersMayRead) {
  write("aws_access_key_id = one\naws_secret_access_key = two\n",
        fs::perms::owner_read | fs::perms::group_read);
  S3CredentialsSource source(file_);
  EXPECT_THAT([&] { (void)source.current(); },
              ThrowsSaying<maps::InputError>({file_.string(), "mode 0440", "chmod 600"}));
}

TEST_F(S3CredentialsTest, MessagesNeverHoldAValue) {
  write("aws_access_key_id = AKIDONE\nsecretword\n");
  S3CredentialsSource source(file_);
  try {
    (void)source.current();
    FAIL() << "no error";
  } catch (const maps::InputError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("line 2"));
    EXPECT_THAT(error.what(), testing::Not(testing::HasSubstr("secretword")));
    EXPECT_THAT(error.what(), testing::Not(testing::HasSubstr("AKIDONE")));
  }
}

TEST_F(S3CredentialsTest, WithoutAFileTheEnvironmentHasThem) {
  ::setenv("AWS_ACCESS_KEY_ID", "test:tester", 1);
  ::unsetenv("AWS_SECRET_ACCESS_KEY");
  S3CredentialsSource source;
  EXPECT_THAT([&] { (void)source.current(); },
              ThrowsSaying<maps::InputError>({"AWS_SECRET_ACCESS_KEY", "s3.credentials_file"}));
  ::setenv("AWS_SECRET_ACCESS_KEY", "testing", 1);
  EXPECT_EQ(source.current().access_key_id, "test:tester");
  ::unsetenv("AWS_ACCESS_KEY_ID");
  ::unsetenv("AWS_SECRET_ACCESS_KEY");
}

}  // namespace s3_credentials_test
}  // namespace stillmap::server
