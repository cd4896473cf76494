// Reads a replay file (FORMAT.md) from a stream, block by block, in fixed memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "shared/status/status.h"
#include "tests/replay/replay_format.h"

namespace ivfm::replay {

// Where the bytes of a file come from.
class ByteSource {
 public:
  // Fills as much of `out` as there is; fewer than asked for: the end, or an error.
  virtual std::size_t read(std::span<std::uint8_t> out) = 0;

 protected:
  ~ByteSource() = default;
};

// Values out of checked blocks. After the first failure status() says why and every value is 0.
class ReplayReader {
 public:
  explicit ReplayReader(ByteSource& source) : source_(source) {}

  // The file's beginning. kCorrupt: no replay file, or impossible settings; kUnsupported: another
  // version; kTruncated: ends early.
  Status read_header(Header& header);
  // Whether all records are read, or reading failed. kCorrupt: a wrong checksum, or bytes after the
  // end; kTruncated: ends early.
  bool at_end();
  Status status() const { return status_; }
  // To be called when a value makes no sense.
  void fail(Status status);

  std::uint8_t u8();
  std::uint64_t varint();  // 7 bits a byte, lowest first; at most 10 bytes
  std::int64_t signed_varint();
  void bytes(std::span<std::uint8_t> out);

 private:
  bool next_block();
  bool fetch(std::span<std::uint8_t> out);

  ByteSource& source_;
  Status status_ = Status::kOk;
  std::array<std::uint8_t, kMaxBlockBytes> block_{};
  std::size_t size_ = 0;
  std::size_t position_ = 0;
  bool ended_ = false;
  std::uint32_t crc_ = 0;
};

}  // namespace ivfm::replay
