#pragma once

#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "support/disk_calls.hpp"

namespace stillmap::test {

/// What a disk may hold after a power cut: everything synced, and of the rest any part in any
/// order. Bytes of a file last with a sync of it, its name only with a sync of its folder.
class DiskModel {
 public:
  /// What becomes of the changes that were not synced.
  enum class Unsynced { kLost, kKept, kAtRandom };

  /// @param root  the folder whose content is modelled; empty at first.
  explicit DiskModel(std::filesystem::path root) : root_path_(std::move(root)) {}

  void apply(const RecordedCall& call) {
    using Kind = server::DiskCall::Kind;
    switch (call.kind) {
      case Kind::kMakeFolder:
      case Kind::kCreateFile:
        return link({{call.path, std::make_shared<Node>(call.kind == Kind::kMakeFolder)}});
      case Kind::kRename:
        return rename(call.path, call.to);
      case Kind::kExchange:
        return exchange(call.path, call.to);
      case Kind::kLink:
        return link({{call.to, at(call.path)}});
      case Kind::kRemoveFile:
      case Kind::kRemoveFolder:
        return link({{call.path, nullptr}});
      case Kind::kWrite:
      case Kind::kTruncate:
      case Kind::kAllocate:
        return at(call.path)->pending_bytes.push_back(call);
      case Kind::kSyncFile:
        return sync_bytes(*at(call.path));
      case Kind::kSyncFolder:
        return sync_names(*at(call.path));
    }
  }

  /// Writes one state of the disk into an empty folder.
  void write_state(const std::filesystem::path& folder, Unsynced unsynced, unsigned seed) const {
    std::mt19937 random(seed);
    write(*root_, folder, unsynced, random);
  }

 private:
  static constexpr std::size_t kSectorBytes = 512;
  struct Node;
  using Names = std::map<std::string, std::shared_ptr<Node>>;
  /// Names set and, where the node is null, removed; all or none.
  using NameChange = std::vector<std::pair<std::string, std::shared_ptr<Node>>>;
  struct Node {
    explicit Node(bool folder) : is_folder(folder) {}
    bool is_folder;
    Names names, synced_names;
    std::vector<NameChange> pending_names;
    std::string synced_bytes;
    std::vector<RecordedCall> pending_bytes;
  };

  [[nodiscard]] std::shared_ptr<Node> at(const std::filesystem::path& path) const {
    std::shared_ptr<Node> node = root_;
    const std::filesystem::path inside = path.lexically_relative(root_path_);
    if (inside == ".") return node;
    for (const auto& part : inside) {
      const auto found = node->names.find(part.string());
      if (found == node->names.end()) throw std::logic_error(path.string() + " was never made");
      node = found->second;
    }
    return node;
  }

  /// Between two folders it may last in either, both or none: POSIX promises nothing, and file
  /// systems with a journal promise more.
  void rename(const std::filesystem::path& from, const std::filesystem::path& to) {
    const std::shared_ptr<Node> node = at(from);
    if (from.parent_path() == to.parent_path()) return link({{from, nullptr}, {to, node}});
    link({{to, node}});
    link({{from, nullptr}});
  }

  /// As `rename`; both names of one folder change together.
  void exchange(const std::filesystem::path& one, const std::filesystem::path& other) {
    const std::shared_ptr<Node> node = at(one), other_node = at(other);
    if (one.parent_path() == other.parent_path()) return link({{one, other_node}, {other, node}});
    link({{other, node}});
    link({{one, other_node}});
  }

  void link(const std::vector<std::pair<std::filesystem::path, std::shared_ptr<Node>>>& changes) {
    const std::filesystem::path folder_path = changes.front().first.parent_path();
    const std::shared_ptr<Node> folder = at(folder_path);
    NameChange change;
    for (const auto& [path, node] : changes) {
      if (path.parent_path() != folder_path) throw std::logic_error("changes in two folders");
      change.emplace_back(path.filename().string(), node);
    }
    set(folder->names, change);
    folder->pending_names.push_back(std::move(change));
  }

  static void set(Names& names, const NameChange& change) {
    for (const auto& [name, node] : change) {
      if (node)
        names[name] = node;
      else
        names.erase(name);
    }
  }

  static void put(std::string& bytes, std::size_t offset, std::string_view piece) {
    if (bytes.size() < offset + piece.size()) bytes.resize(offset + piece.size());
    bytes.replace(offset, piece.size(), piece);
  }

  static void sync_bytes(Node& file) {
    for (const RecordedCall& call : file.pending_bytes) {
      if (call.kind != server::DiskCall::Kind::kWrite)
        file.synced_bytes.resize(call.offset);
      else
        put(file.synced_bytes, call.offset, call.bytes);
    }
    file.pending_bytes.clear();
  }

  static void sync_names(Node& folder) {
    for (const NameChange& change : folder.pending_names) set(folder.synced_names, change);
    folder.pending_names.clear();
  }

  static bool lasts(Unsynced unsynced, std::mt19937& random) {
    return unsynced == Unsynced::kKept || (unsynced == Unsynced::kAtRandom && random() % 2 == 0);
  }

  /// Whole sectors last or not, each for itself.
  static void tear(std::string& bytes, const RecordedCall& call, Unsynced unsynced,
                   std::mt19937& random) {
    for (std::size_t from = 0; from < call.bytes.size();) {
      const std::size_t next = (call.offset + from) / kSectorBytes * kSectorBytes + kSectorBytes;
      const std::size_t to = std::min<std::size_t>(call.bytes.size(), next - call.offset);
      if (lasts(unsynced, random))
        put(bytes, call.offset + from, std::string_view(call.bytes).substr(from, to - from));
      from = to;
    }
  }

  static std::string bytes_of(const Node& file, Unsynced unsynced, std::mt19937& random) {
    std::string bytes = file.synced_bytes;
    for (const RecordedCall& call : file.pending_bytes) {
      if (call.kind == server::DiskCall::Kind::kWrite)
        tear(bytes, call, unsynced, random);
      else if (lasts(unsynced, random))
        bytes.resize(call.offset);
    }
    return bytes;
  }

  static void write(const Node& folder, const std::filesystem::path& path, Unsynced unsynced,
                    std::mt19937& random) {
    Names names = folder.synced_names;
    for (const NameChange& change : folder.pending_names)
      if (lasts(unsynced, random)) set(names, change);
    for (const auto& [name, node] : names) {
      if (node->is_folder) {
        std::filesystem::create_directory(path / name);
        write(*node, path / name, unsynced, random);
        continue;
      }
      std::ofstream(path / name, std::ios::binary) << bytes_of(*node, unsynced, random);
    }
  }

  std::filesystem::path root_path_;
  std::shared_ptr<Node> root_ = std::make_shared<Node>(true);
};

}  // namespace stillmap::test
