#include "blobs/blob_cache.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include <atomic>
#include <barrier>
#include <filesystem>
#include <map>
#include <mutex>
#include <optional>
#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>
#include <string>
#include <thread>
#include <vector>

#include "store/disk_full.hpp"
#include "support/disk_calls.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace blob_cache_test {

namespace fs = std::filesystem;
using test::ThrowsSaying;

constexpr std::size_t kBlobBytes = std::size_t{64} << 10U;

class BlobCacheTest : public testing::Test {
 protected:
  /// A blob that the remote side has. @return its name.
  std::string blob(char content) {
    const std::string bytes(kBlobBytes, content);
    const std::string sha256 = maps::sha256_of(bytes);
    remote_[sha256] = bytes;
    return sha256;
  }
  BlobCache cache(std::uint64_t most_blobs = 100, DiskCalls* calls = nullptr) {
    return BlobCache(
        {.folder = folder_, .most_bytes = most_blobs * kBlobBytes},
        [this](const std::string& sha256, const BlobCache::Sink& sink) { fetch(sha256, sink); },
        calls == nullptr ? calls_ : *calls);
  }
  void fetch(const std::string& sha256, const BlobCache::Sink& sink) {
    ++fetched_;
    const std::string& bytes = remote_.at(sha256);
    const std::size_t half = bytes.size() / 2;
    sink(std::string_view(bytes).substr(0, half));
    if (lost_) throw maps::StorageError("s3://maps/" + sha256, "away");
    sink(std::string_view(bytes).substr(half));
  }
  std::string read(BlobCache& cache, const std::string& sha256) {
    return cache.open(sha256, kBlobBytes).text();
  }
  /// As if it had been used last so long ago.
  void age(const std::string& sha256, int seconds) {
    const fs::path file = folder_ / "blobs" / sha256.substr(0, 2) / sha256;
    fs::last_write_time(file, fs::file_time_type::clock::now() - std::chrono::seconds(seconds));
  }
  std::vector<std::string> leftovers() {
    std::vector<std::string> found;
    for (const auto& entry : fs::directory_iterator(folder_ / "blobs"))
      if (entry.path().filename().string().starts_with("."))
        found.push_back(entry.path().filename().string());
    return found;
  }

  test::TemporaryFolder parent_;
  fs::path folder_ = parent_.path() / "cache";
  test::UnsyncedCalls calls_;
  std::map<std::string, std::string> remote_;
  std::atomic<int> fetched_ = 0;
  std::atomic<bool> lost_ = false;
};

TEST_F(BlobCacheTest, FetchesABlobOnce) {
  const std::string one = blob('1');
  BlobCache cache = this->cache();
  EXPECT_EQ(read(cache, one), remote_[one]);
  EXPECT_EQ(read(cache, one), remote_[one]);
  EXPECT_EQ(fetched_, 1);
  EXPECT_EQ(cache.figures().fetched, 1U);
  EXPECT_EQ(cache.figures().found, 1U);
  EXPECT_EQ(cache.figures().used_bytes, cache.used_bytes());
  // The next process finds it.
  BlobCache next = this->cache();
  EXPECT_EQ(read(next, one), remote_[one]);
  EXPECT_EQ(fetched_, 1);
  EXPECT_THAT(leftovers(), testing::IsEmpty());
}

TEST_F(BlobCacheTest, TheLeastRecentlyUsedGoesFirst) {
  const std::string one = blob('1'), two = blob('2'), three = blob('3'), four = blob('4');
  BlobCache cache = this->cache(3);
  for (const std::string& each : {one, two, three}) (void)read(cache, each);
  age(one, 300);
  age(two, 200);
  age(three, 100);
  // Used again.
  (void)read(cache, one);
  (void)read(cache, four);
  EXPECT_TRUE(cache.has(one));
  EXPECT_FALSE(cache.has(two));
  EXPECT_TRUE(cache.has(four));
  EXPECT_LE(cache.used_bytes(), 3 * kBlobBytes);
  EXPECT_EQ(read(cache, two), remote_[two]);
  EXPECT_EQ(fetched_, 5);
}

TEST_F(BlobCacheTest, AReaderNeverNoticesAnEviction) {
  const std::string one = blob('1'), two = blob('2');
  BlobCache cache = this->cache(1);
  const BlobCache::Reader reader = cache.open(one, kBlobBytes);
  void* const mapped = ::mmap(nullptr, kBlobBytes, PROT_READ, MAP_PRIVATE, reader.descriptor(), 0);
  ASSERT_NE(mapped, MAP_FAILED);
  (void)read(cache, two);
  EXPECT_FALSE(cache.has(one));
  EXPECT_EQ(reader.text(), remote_[one]);
  EXPECT_EQ(std::string_view(static_cast<const char*>(mapped), kBlobBytes), remote_[one]);
  ::munmap(mapped, kBlobBytes);
}

TEST_F(BlobCacheTest, ABlobWithASecondNameStays) {
  const std::string one = blob('1'), two = blob('2'), three = blob('3');
  BlobCache cache = this->cache(2);
  cache.link(one, kBlobBytes, folder_ / "used");
  age(one, 1000);
  (void)read(cache, two);
  (void)read(cache, three);
  EXPECT_TRUE(cache.has(one));
  EXPECT_FALSE(cache.has(two));
  cache.link(three, kBlobBytes, folder_ / "used, too");
  EXPECT_THAT([&] { (void)read(cache, two); },
              ThrowsSaying<maps::StorageError>({folder_.string(), "raise cache_bytes"}));
  // Whoever holds the names may give one up.
  cache.set_release([&] { return fs::remove(folder_ / "used"); });
  EXPECT_EQ(read(cache, two), remote_[two]);
  EXPECT_FALSE(cache.has(one));
  EXPECT_TRUE(cache.has(three));
}

TEST_F(BlobCacheTest, ThreadsShareADownload) {
  const std::string one = blob('1');
  BlobCache cache = this->cache();
  constexpr int kThreads = 16;
  std::barrier together(kThreads);
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < kThreads; ++i)
      threads.emplace_back([&] {
        together.arrive_and_wait();
        EXPECT_EQ(read(cache, one), remote_[one]);
      });
  }
  EXPECT_EQ(fetched_, 1);
}

TEST_F(BlobCacheTest, AFailureReachesAllThatWaitAndIsForgotten) {
  const std::string one = blob('1');
  BlobCache cache = this->cache();
  lost_ = true;
  std::atomic<int> failures = 0;
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 8; ++i)
      threads.emplace_back([&] {
        try {
          (void)read(cache, one);
        } catch (const maps::StorageError&) {
          ++failures;
        }
      });
  }
  EXPECT_EQ(failures, 8);
  EXPECT_FALSE(cache.has(one));
  EXPECT_THAT(leftovers(), testing::IsEmpty());
  lost_ = false;
  EXPECT_EQ(read(cache, one), remote_[one]);
}

TEST_F(BlobCacheTest, ACorruptDownloadIsTriedOnceMoreAndNeverKept) {
  const std::string one = blob('1');
  const std::string right = remote_[one];
  for (const std::string& wrong :
       {right.substr(1), right + "x", "x" + right.substr(1), std::string()}) {
    remote_[one] = wrong;
    BlobCache cache = this->cache();
    fetched_ = 0;
    EXPECT_THAT([&] { (void)read(cache, one); }, ThrowsSaying<maps::InputError>({one}));
    EXPECT_EQ(fetched_, 2);
    EXPECT_FALSE(cache.has(one));
    EXPECT_THAT(leftovers(), testing::IsEmpty());
  }
  remote_[one] = "x" + right.substr(1);
  BlobCache cache({.folder = folder_}, [&](const std::string& sha256, const BlobCache::Sink& sink) {
    fetch(sha256, sink);
    remote_[one] = right;
  });
  EXPECT_EQ(read(cache, one), right);
}

TEST_F(BlobCacheTest, ALostFolderIsFilledAgain) {
  const std::string one = blob('1'), two = blob('2');
  BlobCache cache = this->cache();
  (void)read(cache, one);
  fs::remove_all(folder_);
  EXPECT_EQ(read(cache, two), remote_[two]);
  EXPECT_EQ(read(cache, one), remote_[one]);
}

TEST_F(BlobCacheTest, ABlobThatWasCutIsFetchedAgain) {
  const std::string one = blob('1');
  BlobCache cache = this->cache();
  (void)read(cache, one);
  fs::resize_file(folder_ / "blobs" / one.substr(0, 2) / one, 10);
  EXPECT_EQ(read(cache, one), remote_[one]);
}

TEST_F(BlobCacheTest, AFullDiskIsNamedAndLeavesNoHalfFile) {
  const std::string one = blob('1');
  test::FullDisk full;
  full.fill();
  BlobCache cache = this->cache(100, &full);
  EXPECT_THAT([&] { (void)read(cache, one); },
              ThrowsSaying<DiskFull>({folder_.string(), "disk of the cache is full"}));
  EXPECT_FALSE(cache.has(one));
  EXPECT_THAT(leftovers(), testing::IsEmpty());
}

TEST_F(BlobCacheTest, LeftoversOfAKilledProcessGo) {
  (void)cache();
  fs::create_directories(folder_ / "blobs" / ".incoming-1-0");
  parent_.write("cache/blobs/.incoming-1-0/0", "half");
  (void)cache();
  EXPECT_THAT(leftovers(), testing::IsEmpty());
}

TEST_F(BlobCacheTest, SeveralCachesMayShareAFolder) {
  std::vector<std::string> names;
  for (char c = 'a'; c < 'a' + 24; ++c) names.push_back(blob(c));
  constexpr int kCaches = 4;
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < kCaches; ++i)
      threads.emplace_back([&, i] {
        // As of another process: nothing is shared but the folder.
        BlobCache cache = this->cache(8);
        for (std::size_t at = 0; at < 4 * names.size(); ++at) {
          const std::string& name = names[(at * (2 * static_cast<unsigned>(i) + 1)) % names.size()];
          EXPECT_EQ(read(cache, name), remote_.at(name));
        }
      });
  }
  BlobCache cache = this->cache(8);
  (void)read(cache, names[0]);
  EXPECT_LE(cache.used_bytes(), (8 + kCaches) * kBlobBytes);
  EXPECT_THAT(leftovers(), testing::IsEmpty());
}

TEST_F(BlobCacheTest, WhatIsTakenIsBounded) {
  BlobCache cache = this->cache(4);
  for (char c = 'a'; c < 'a' + 12; ++c) {
    const std::string name = blob(c);
    const fs::path file = parent_.write("cache/packages/file", remote_[name]);
    cache.adopt(name, file);
    fs::remove(file);
  }
  EXPECT_LE(cache.used_bytes(), 5 * kBlobBytes);
  EXPECT_TRUE(cache.has(maps::sha256_of(std::string(kBlobBytes, 'l'))));
}

TEST_F(BlobCacheTest, TakesAFileThatIsThere) {
  const std::string one = blob('1');
  BlobCache cache = this->cache();
  const fs::path file = parent_.write("cache/packages/file", remote_[one]);
  cache.adopt(one, file);
  EXPECT_EQ(read(cache, one), remote_[one]);
  EXPECT_EQ(fetched_, 0);
  EXPECT_LE(cache.used_bytes(), kBlobBytes);
}

}  // namespace blob_cache_test
}  // namespace stillmap::server
