#include <stillmap/maps/scratch_vector.hpp>

#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <new>

namespace stillmap::maps {
namespace {

/// Pieces after which those before give their memory back: who appends has done with them.
constexpr std::size_t kPiecesInUse = 8;

std::size_t whole_pages(std::size_t bytes) {
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  return (bytes + page - 1) / page * page;
}

}  // namespace

ScratchPieces::ScratchPieces(const std::filesystem::path& folder, std::size_t piece_bytes)
    : folder_(folder), piece_bytes_(whole_pages(piece_bytes)) {}

ScratchPieces::~ScratchPieces() {
  for (void* piece : pieces_) ::munmap(piece, piece_bytes_);
}

void* ScratchPieces::add() {
  if (pieces_.size() % kPiecesInUse == 0) rest();
  void*& piece = pieces_.emplace_back(nullptr);
  try {
    piece = mapped();
  } catch (...) {
    pieces_.pop_back();
    throw;
  }
  return piece;
}

void* ScratchPieces::mapped() {
  if (!folder_.empty()) {
    if (!file_) {
      file_ = std::make_unique<ScratchFile>(folder_, "pieces");
      file_->remove_name();
    }
    return file_->append_mapped(piece_bytes_);
  }
  void* piece =
      ::mmap(nullptr, piece_bytes_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (piece == MAP_FAILED) throw std::bad_alloc();
  return piece;
}

void ScratchPieces::rest() const {
  if (folder_.empty()) return;
  for (void* piece : pieces_) ::madvise(piece, piece_bytes_, MADV_DONTNEED);
}

}  // namespace stillmap::maps
