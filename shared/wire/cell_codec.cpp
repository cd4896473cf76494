#include "shared/wire/cell_codec.h"

#include <array>
#include <bit>

namespace ivfm {
namespace {

constexpr unsigned kMaxRunLog2 = 12;  // kMaxBlockCells is 2^12

constexpr bool is_rows(CellCoding coding) {
  return coding == CellCoding::kPackedRows || coding == CellCoding::kRunRows;
}
constexpr bool is_runs(CellCoding coding) {
  return coding == CellCoding::kRuns || coding == CellCoding::kRunRows;
}
constexpr bool is_valid_shape(std::size_t count, std::size_t width) {
  return count != 0 && count <= kMaxBlockCells && width != 0 && count % width == 0;
}

// Differences modulo 256, small ones of either sign to small numbers: 0, -1, 1, -2, 2 ...
constexpr std::uint8_t zigzag(std::uint8_t difference) {
  return static_cast<std::uint8_t>((difference << 1) ^ (difference & 0x80u ? 0xffu : 0u));
}
constexpr std::uint8_t unzigzag(std::uint8_t coded) {
  return static_cast<std::uint8_t>((coded >> 1) ^ (coded & 1u ? 0xffu : 0u));
}

// The numbers to code: the cells themselves or their differences to the row below.
class Symbols {
 public:
  Symbols(std::span<const std::uint8_t> cells, std::size_t width, bool rows)
      : cells_(cells), width_(width), rows_(rows) {}

  std::size_t size() const { return cells_.size(); }
  std::uint8_t operator[](std::size_t i) const {
    if (!rows_) return cells_[i];
    const unsigned below = i >= width_ ? cells_[i - width_] : 0u;
    return zigzag(static_cast<std::uint8_t>((cells_[i] - below) & 0xffu));
  }

 private:
  std::span<const std::uint8_t> cells_;
  std::size_t width_;
  bool rows_;
};

// Calls visit(symbol, run length) for every maximal run.
template <typename Visit>
void for_each_run(const Symbols& symbols, Visit visit) {
  std::size_t start = 0;
  std::uint8_t symbol = symbols[0];
  for (std::size_t i = 1; i <= symbols.size(); ++i) {
    const std::uint8_t next = i < symbols.size() ? symbols[i] : std::uint8_t{0};
    if (i < symbols.size() && next == symbol) continue;
    visit(symbol, static_cast<std::uint32_t>(i - start));
    start = i;
    symbol = next;
  }
}

struct Plan {
  CellCoding coding = CellCoding::kRaw;
  unsigned bits = 0;           // a symbol's
  std::size_t size_bytes = 0;  // with the first byte
};

constexpr std::size_t bytes_for(std::size_t bits) { return 1 + (bits + 7) / 8; }

void consider(Plan& best, CellCoding coding, unsigned bits, std::size_t payload_bits) {
  const std::size_t size_bytes = bytes_for(payload_bits);
  if (size_bytes < best.size_bytes) best = {coding, bits, size_bytes};
}

void consider_symbols(Plan& best, const Symbols& symbols, CellCoding packed, CellCoding runs) {
  std::uint8_t all = 0;
  std::size_t run_count = 0, length_bits = 0;
  for_each_run(symbols, [&](std::uint8_t symbol, std::uint32_t length) {
    all = static_cast<std::uint8_t>(all | symbol);
    ++run_count;
    length_bits += 2 * static_cast<std::size_t>(std::bit_width(length)) - 1;
  });
  const auto bits = static_cast<unsigned>(std::bit_width(all));
  if (bits < 8) consider(best, packed, bits, symbols.size() * bits);
  if (bits > 0) consider(best, runs, bits, run_count * bits + length_bits);
}

Plan plan(std::span<const std::uint8_t> cells, std::size_t width) {
  Plan best{CellCoding::kRaw, 0, cells.size() + 1};
  consider_symbols(best, Symbols(cells, width, false), CellCoding::kPacked, CellCoding::kRuns);
  consider_symbols(best, Symbols(cells, width, true), CellCoding::kPackedRows,
                   CellCoding::kRunRows);
  return best;
}

// Bits from the lowest of the first byte upwards. The caller has planned enough room.
class BitWriter {
 public:
  explicit BitWriter(std::span<std::uint8_t> bytes) : bytes_(bytes) {
    for (std::uint8_t& byte : bytes_) byte = 0;
  }
  void put(std::uint32_t value, unsigned bits) {
    for (unsigned i = 0; i < bits; ++i, ++position_) {
      const unsigned bit = (value >> i) & 1u;
      bytes_[position_ / 8] =
          static_cast<std::uint8_t>(bytes_[position_ / 8] | (bit << (position_ % 8)));
    }
  }

 private:
  std::span<std::uint8_t> bytes_;
  std::size_t position_ = 0;
};

void write_packed(const Symbols& symbols, unsigned bits, BitWriter& writer) {
  for (std::size_t i = 0; i < symbols.size(); ++i) writer.put(symbols[i], bits);
}

// A run: the symbol, then its length in Elias' gamma code: as many 0 bits as the length has bits
// below its highest, a 1, and those bits.
void write_runs(const Symbols& symbols, unsigned bits, BitWriter& writer) {
  for_each_run(symbols, [&](std::uint8_t symbol, std::uint32_t length) {
    const auto low_bits = static_cast<unsigned>(std::bit_width(length)) - 1;
    writer.put(symbol, bits);
    writer.put(1u << low_bits, low_bits + 1);
    writer.put(length, low_bits);
  });
}

// Reads bits byte by byte from a ByteReader: takes no byte more than it needs.
class BitReader {
 public:
  explicit BitReader(ByteReader& reader) : reader_(reader) {}
  std::uint32_t get(unsigned bits) {
    std::uint32_t value = 0;
    for (unsigned i = 0; i < bits; ++i) value |= static_cast<std::uint32_t>(next_bit()) << i;
    return value;
  }
  // What the last byte holds beyond the bits read.
  unsigned padding() const { return current_; }

 private:
  unsigned next_bit() {
    if (left_ == 0) {
      current_ = reader_.u8();
      left_ = 8;
    }
    const unsigned bit = current_ & 1u;
    current_ >>= 1;
    --left_;
    return bit;
  }

  ByteReader& reader_;
  unsigned current_ = 0;
  unsigned left_ = 0;
};

Status read_raw(ByteReader& reader, std::span<std::uint8_t> cells) {
  const auto source = reader.bytes(cells.size());
  if (!reader.ok()) return Status::kTruncated;
  for (std::size_t i = 0; i < cells.size(); ++i) cells[i] = source[i];
  return Status::kOk;
}

Status read_packed(ByteReader& reader, BitReader& bit_reader, unsigned bits,
                   std::span<std::uint8_t> symbols) {
  for (std::uint8_t& symbol : symbols) symbol = static_cast<std::uint8_t>(bit_reader.get(bits));
  return reader.ok() ? Status::kOk : Status::kTruncated;
}

Status read_runs(ByteReader& reader, BitReader& bit_reader, unsigned bits,
                 std::span<std::uint8_t> symbols) {
  std::size_t filled = 0;
  while (filled < symbols.size()) {
    const auto symbol = static_cast<std::uint8_t>(bit_reader.get(bits));
    unsigned low_bits = 0;
    while (low_bits <= kMaxRunLog2 && bit_reader.get(1) == 0) ++low_bits;
    if (!reader.ok()) return Status::kTruncated;
    if (low_bits > kMaxRunLog2) return Status::kCorrupt;
    const std::size_t length = (std::size_t{1} << low_bits) + bit_reader.get(low_bits);
    if (!reader.ok()) return Status::kTruncated;
    if (length > symbols.size() - filled) return Status::kCorrupt;
    for (std::size_t i = 0; i < length; ++i) symbols[filled++] = symbol;
  }
  return Status::kOk;
}

void undo_row_differences(std::size_t width, std::span<std::uint8_t> cells) {
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const unsigned below = i >= width ? cells[i - width] : 0u;
    cells[i] = static_cast<std::uint8_t>((unzigzag(cells[i]) + below) & 0xffu);
  }
}

}  // namespace

Result<std::size_t> encode_cells(std::span<const std::uint8_t> cells, std::size_t width,
                                 std::span<std::uint8_t> out) {
  if (!is_valid_shape(cells.size(), width)) return Status::kInvalidArgument;
  const Plan best = plan(cells, width);
  if (best.size_bytes > out.size()) return Status::kFull;
  out[0] = static_cast<std::uint8_t>(static_cast<unsigned>(best.coding) | (best.bits << 3));
  const auto payload = out.subspan(1, best.size_bytes - 1);
  if (best.coding == CellCoding::kRaw) {
    for (std::size_t i = 0; i < cells.size(); ++i) payload[i] = cells[i];
    return best.size_bytes;
  }
  BitWriter writer(payload);
  const Symbols symbols(cells, width, is_rows(best.coding));
  if (is_runs(best.coding)) {
    write_runs(symbols, best.bits, writer);
  } else {
    write_packed(symbols, best.bits, writer);
  }
  return best.size_bytes;
}

Status decode_cells(ByteReader& reader, std::size_t width, std::span<std::uint8_t> cells) {
  if (!is_valid_shape(cells.size(), width)) return Status::kInvalidArgument;
  const std::uint8_t first = reader.u8();
  if (!reader.ok()) return Status::kTruncated;
  const auto coding = static_cast<CellCoding>(first & 7u);
  const unsigned bits = first >> 3;
  if (coding > CellCoding::kRunRows) return Status::kUnsupported;
  if (coding == CellCoding::kRaw) return bits == 0 ? read_raw(reader, cells) : Status::kCorrupt;
  const bool runs = is_runs(coding);
  if (runs ? bits < 1 || bits > 8 : bits > 7) return Status::kCorrupt;
  BitReader bit_reader(reader);
  const Status status = runs ? read_runs(reader, bit_reader, bits, cells)
                             : read_packed(reader, bit_reader, bits, cells);
  if (!ok(status)) return status;
  if (bit_reader.padding() != 0) return Status::kCorrupt;
  if (is_rows(coding)) undo_row_differences(width, cells);
  return Status::kOk;
}

}  // namespace ivfm
