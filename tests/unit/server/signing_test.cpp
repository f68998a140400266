#include "signing/map_signature.hpp"

#include <gmock/gmock.h>
#include <sys/stat.h>
#include <stillmap/maps/error.hpp>

#include <fstream>

#include "service_fixture.hpp"
#include "support/store_refusals.hpp"
#include "support/stored_packages.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace signing_test {

namespace fs = std::filesystem;
using test::expect_refused;
using test::TemporaryFolder;
using test::ThrowsSaying;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Reason = StoreRefusal::Reason;

/// RFC 8032, 7.1, TEST 2: a text of one byte.
TEST(Ed25519, IsThatOfTheStandard) {
  const PublicKey key = "3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c";
  std::string signature =
      "92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da"
      "085ac1e43e15996e458f3613d0f11d8c387b2eaeb4302aeeb00d291612bb0c00";
  EXPECT_TRUE(is_signature(signature, "\x72", key));
  EXPECT_FALSE(is_signature(signature, "\x73", key));
  EXPECT_FALSE(is_signature(signature, "\x72", std::string(64, '0')));
  signature.front() = '8';
  EXPECT_FALSE(is_signature(signature, "\x72", key));
  for (const std::string text : {"", "zz", "92A0"}) EXPECT_FALSE(is_signature(text, "\x72", key));
}

TEST(Ed25519, KeepsKeysInFiles) {
  const TemporaryFolder folder;
  const fs::path file = folder.path() / "key", all = folder.path() / "all.pem";
  const SigningKey key = SigningKey::make(), other = SigningKey::make();
  key.write(file);
  struct stat status {};
  ASSERT_EQ(::stat(file.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U) << "its owner's alone";
  EXPECT_EQ(SigningKey::read(file).sign("a"), key.sign("a"));
  EXPECT_THAT([&] { other.write(file); }, ThrowsSaying<maps::InputError>({"another name"}));
  key.write_public(folder.path() / "1");
  other.write_public(folder.path() / "2");
  std::ofstream(all) << std::ifstream(folder.path() / "1").rdbuf()
                     << std::ifstream(folder.path() / "2").rdbuf();
  EXPECT_EQ(read_public_keys(all), (PublicKeys{key.public_key(), other.public_key()}));
  EXPECT_THAT([&] { (void)read_public_keys(file); }, ThrowsSaying<maps::InputError>({"keys sign"}));
  EXPECT_THAT([&] { (void)SigningKey::read(all); }, ThrowsSaying<maps::InputError>({"keys sign"}));
}

TEST(MapSignature, LiesBesideTheManifestOnceForEachKey) {
  const TemporaryFolder folder;
  const SigningKey key = SigningKey::make(), other = SigningKey::make();
  EXPECT_THAT(signatures_beside(folder.path()), IsEmpty());
  const auto one = sign_map(key, "town", "1"), two = sign_map(other, "town", "1");
  add_signature_beside(folder.path(), sign_map(key, "town", "0"));
  add_signature_beside(folder.path(), two);
  add_signature_beside(folder.path(), one);
  EXPECT_THAT(signatures_beside(folder.path()), ElementsAre(two, one));
  for (const char* text : {"", "[]", "{}", R"({"signatures": [1]})", R"({"signatures": 1})",
                           R"({"signatures": [{"key": "ab", "signature": "cd"}]})"})
    EXPECT_THAT([&] { (void)parse_signatures(text, "it"); },
                ThrowsSaying<maps::InputError>({"it", "sign again"}))
        << text;
}

/// A server of `town`, which nobody has signed, with packages that are to become `yard`.
class TrustTest : public ServiceTest {
 protected:
  TrustTest() {
    for (const int seed : {1, 2})
      digests_.push_back(test::write_sharing_package(package(seed), seed));
    key_.write_public(folder_.path() / "trusted.pem");
    options_.trusted_keys_file = folder_.path() / "trusted.pem";
  }
  [[nodiscard]] fs::path package(int seed) const { return folder_.path() / std::to_string(seed); }
  [[nodiscard]] MapSignature by(const SigningKey& key, int seed) const {
    return sign_map(key, "yard", digests_[static_cast<std::size_t>(seed - 1)]);
  }
  HttpResponse put_signature(const std::string& version, const MapSignature& signature) const {
    HttpRequest put = request("PUT", "/v1/maps/" + version + "/signatures");
    put.headers = {{"content-type", "application/json"}};
    put.body = signatures_text({signature});
    return service_->handle(put);
  }
  [[nodiscard]] HttpResponse activate(const std::string& version) const {
    return service_->handle(request("POST", "/v1/maps/yard/versions/" + version + "/activate"));
  }
  /// Until the server has noticed.
  [[nodiscard]] bool becomes(const std::string& map, const char* state) const {
    for (int i = 0; i < 500; ++i) {
      if (body(get("/v1/maps/" + map)).value("state", "") == state) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return false;
  }

  TemporaryFolder folder_;
  std::vector<std::string> digests_;
  SigningKey key_ = SigningKey::make(), other_ = SigningKey::make();
};

TEST_F(TrustTest, TakesOnlyWhatIsSigned) {
  PackageStore& store = store_.open();
  store.set_trust(PublicKeys{key_.public_key()});
  expect_refused(Reason::kNotSigned, [&] { store.add("yard", "v1", package(1)); });
  add_signature_beside(package(1), by(other_, 1));
  expect_refused(Reason::kNotSigned, [&] { store.add("yard", "v1", package(1)); });
  add_signature_beside(package(1), by(key_, 1));
  EXPECT_TRUE(store.add("yard", "v1", package(1)).is_new);
  EXPECT_EQ(store.signatures().of("yard", digests_[0]).size(), 2U);
  store.activate("yard", "v1");
  // As another map it is not signed, and the file says that it is: somebody has mixed them up.
  EXPECT_THAT([&] { store.add("depot", "v1", package(1)); },
              ThrowsSaying<maps::InputError>({"signature", "something else"}));
}

TEST_F(TrustTest, ActivatesAndAnswersOnlyFromWhatIsSigned) {
  store_.open().add("yard", "v1", package(1));
  start();
  EXPECT_TRUE(becomes("town", "failed"));
  const auto refused = service_->handle(good_request());
  EXPECT_EQ(refused.status, 503);
  EXPECT_THAT(body(refused)["detail"], HasSubstr("no trusted key has signed version 'v1'"));
  EXPECT_EQ(body(activate("v1"))["code"], "NotSigned");
  EXPECT_EQ(put_signature("yard/versions/v1", by(key_, 2)).status, 400) << "of another package";
  EXPECT_EQ(put_signature("yard/versions/v1", by(other_, 1)).status, 200);
  EXPECT_EQ(body(activate("v1"))["code"], "NotSigned");
  EXPECT_EQ(put_signature("yard/versions/v1", by(key_, 1)).status, 200);
  EXPECT_EQ(activate("v1").status, 200);
  EXPECT_EQ(put_signature("town/versions/v1", sign_map(key_, "town", store_.digest())).status, 200);
  EXPECT_TRUE(becomes("town", "ready"));
}

TEST_F(TrustTest, StopsToAnswerWhenItsKeyIsTakenAway) {
  store_.open().signatures().add("town", store_.digest(),
                                 {sign_map(key_, "town", store_.digest())});
  start();
  EXPECT_TRUE(becomes("town", "ready"));
  HttpRequest opening = request("POST", "/v1/sessions");
  opening.headers = {{"content-type", "application/json"}};
  opening.body = R"({"map": "town"})";
  const auto session = body(service_->handle(opening));
  HttpRequest scan = request("POST", "/v1/sessions/" + session["id"].get<std::string>() + "/scans");
  scan.headers = {{"content-type", "application/octet-stream"}};
  scan.query = {{"stamp_ns", "1"}};
  scan.body = raw_scan(60);
  EXPECT_EQ(service_->handle(scan).status, 200);
  fs::remove(options_.trusted_keys_file);
  EXPECT_THROW((void)service_->prepare_trust(options_), maps::StorageError);
  EXPECT_TRUE(becomes("town", "ready")) << "nothing changes with a file that cannot be read";
  other_.write_public(options_.trusted_keys_file);
  service_->prepare_trust(options_)();
  scan.query = {{"stamp_ns", "2"}};
  EXPECT_EQ(body(service_->handle(scan))["code"], "NotSigned") << "open sessions too, and at once";
  EXPECT_TRUE(becomes("town", "failed"));
  // Rotated: signed by the new key too.
  store_.open().signatures().add("town", store_.digest(),
                                 {sign_map(other_, "town", store_.digest())});
  EXPECT_TRUE(becomes("town", "ready"));
}

}  // namespace signing_test
}  // namespace stillmap::server
