-- Wireshark and tshark: the datagrams between robots and the map server (shared/wire/FORMAT.md).
--
--   tshark -r run.pcap -X lua_script:ivfm_dissector.lua -o ivfm.keys:keys/server.keys
--
-- Every UDP datagram that begins with the magic and the version is taken, whatever its port.
-- Encrypted content is decrypted with the keys of `ivfm keygen`, and its tag is verified; so is the
-- checksum of what is not encrypted. Both cover the receiver's boot, which is taken from what the
-- receiver has sent before: where that lies outside the recording, the check says so. tshark -2
-- also finds what comes later.

local ivfm = Proto("ivfm", "ivfm robot and map server")

ivfm.prefs.keys = Pref.string("Keys", "", "server.keys or robotN.key of 'ivfm keygen'")

local kinds = {
  [0x01] = "map update", [0x02] = "acknowledgement", [0x03] = "hello", [0x04] = "status",
  [0x05] = "found", [0x06] = "restore request", [0x81] = "map update of the others",
  [0x82] = "acknowledgement by the server", [0x83] = "command", [0x84] = "welcome",
  [0x85] = "restore", [0x86] = "places of other robots",
  [0x87] = "map frame",
}
local layers = {[0] = "visits", [1] = "obstacles", [255] = "end"}
local codings = {[0] = "raw", [1] = "packed", [2] = "runs", [3] = "packed rows", [4] = "run rows"}
local commands = {[1] = "start", [2] = "stop", [3] = "return", [4] = "found by another robot"}
local states = {[0] = "boot", [1] = "ready", [2] = "exploring", [3] = "returning", [4] = "explored",
  [5] = "found", [6] = "fault", [7] = "stopped"}

local f = {
  version = ProtoField.uint8("ivfm.version", "Version", base.DEC, nil, 0xf0),
  unbound = ProtoField.bool("ivfm.unbound", "Receiver's boot unknown", 8, nil, 0x02),
  encrypted = ProtoField.bool("ivfm.encrypted", "Encrypted", 8, nil, 0x01),
  robot = ProtoField.uint16("ivfm.robot", "Robot"),
  epoch = ProtoField.uint32("ivfm.epoch", "Epoch"),
  sequence = ProtoField.uint32("ivfm.sequence", "Sequence"),
  boot = ProtoField.uint64("ivfm.boot", "Boot", base.HEX),
  trailer = ProtoField.bytes("ivfm.trailer", "Trailer"),
  check = ProtoField.string("ivfm.check", "Check of the trailer"),
  kind = ProtoField.uint8("ivfm.kind", "Kind", base.HEX, kinds),
  cell_um = ProtoField.uint24("ivfm.cell_um", "Cell size (um)"),
  x = ProtoField.float("ivfm.x", "x (m)"),
  y = ProtoField.float("ivfm.y", "y (m)"),
  heading = ProtoField.float("ivfm.heading", "Heading (rad)"),
  region = ProtoField.none("ivfm.region", "Region"),
  layer = ProtoField.uint8("ivfm.layer", "Layer", base.DEC, layers),
  column = ProtoField.int24("ivfm.column", "Column"),
  row = ProtoField.int24("ivfm.row", "Row"),
  width = ProtoField.uint16("ivfm.width", "Columns"),
  height = ProtoField.uint16("ivfm.height", "Rows"),
  coding = ProtoField.uint8("ivfm.coding", "Coding", base.DEC, codings, 0x07),
  cells = ProtoField.string("ivfm.cells", "Cells"),
  newest = ProtoField.uint32("ivfm.newest", "Newest"),
  earlier = ProtoField.bytes("ivfm.earlier", "Earlier"),
  name = ProtoField.string("ivfm.name", "Name"),
  state = ProtoField.uint8("ivfm.state", "State", base.DEC, states),
  fault = ProtoField.uint8("ivfm.fault", "Fault", base.HEX),
  uptime_ms = ProtoField.uint32("ivfm.uptime_ms", "Uptime (ms)"),
  actions = ProtoField.uint32("ivfm.actions", "Decisions"),
  distance_mm = ProtoField.uint32("ivfm.distance_mm", "Driven (mm)"),
  decision_us = ProtoField.uint32("ivfm.decision_us", "Last decision (us)"),
  sent = ProtoField.uint32("ivfm.sent", "Datagrams sent"),
  again = ProtoField.uint32("ivfm.again", "Rectangles sent again"),
  target_x_um = ProtoField.int32("ivfm.target_x_um", "Target x (um)"),
  target_y_um = ProtoField.int32("ivfm.target_y_um", "Target y (um)"),
  command = ProtoField.uint8("ivfm.command", "Command", base.DEC, commands),
  revision = ProtoField.uint32("ivfm.revision", "Revision"),
  age = ProtoField.uint8("ivfm.age", "Age (10 ms)"),
  new_epoch = ProtoField.uint32("ivfm.new_epoch", "Epoch"),
  flags = ProtoField.uint8("ivfm.flags", "Flags", base.HEX),
  frame_x_um = ProtoField.int32("ivfm.frame_x_um", "Frame x (um)"),
  frame_y_um = ProtoField.int32("ivfm.frame_y_um", "Frame y (um)"),
  frame_heading = ProtoField.uint16("ivfm.frame_heading", "Frame heading (65536 a turn)"),
  rest = ProtoField.bytes("ivfm.rest", "Not understood"),
}
ivfm.fields = f

local damaged = ProtoExpert.new("ivfm.damaged", "The message is damaged", expert.group.MALFORMED,
  expert.severity.ERROR)
local locked = ProtoExpert.new("ivfm.locked", "No key for this robot", expert.group.DECRYPTION,
  expert.severity.NOTE)
local forged = ProtoExpert.new("ivfm.forged", "The trailer is wrong: changed, or not from a holder "
  .. "of the key", expert.group.CHECKSUM, expert.severity.WARN)
ivfm.experts = {damaged, locked, forged}

-- --- XChaCha20 (RFC 8439, draft-irtf-cfrg-xchacha) ---------------------------------------------

local band, bor, bxor = bit32.band, bit32.bor, bit32.bxor
local lrotate, rshift = bit32.lrotate, bit32.rshift
local unpack = table.unpack

local function words_of(bytes)
  local words = {}
  for i = 1, #bytes, 4 do
    local a, b, c, d = bytes:byte(i, i + 3)
    words[#words + 1] = a + b * 0x100 + c * 0x10000 + d * 0x1000000
  end
  return words
end

local function quarter(s, a, b, c, d)
  s[a] = (s[a] + s[b]) % 0x100000000; s[d] = lrotate(bxor(s[d], s[a]), 16)
  s[c] = (s[c] + s[d]) % 0x100000000; s[b] = lrotate(bxor(s[b], s[c]), 12)
  s[a] = (s[a] + s[b]) % 0x100000000; s[d] = lrotate(bxor(s[d], s[a]), 8)
  s[c] = (s[c] + s[d]) % 0x100000000; s[b] = lrotate(bxor(s[b], s[c]), 7)
end

-- The state after the twenty rounds; key: 8 words, tail: 4 words.
local function rounds(key, tail)
  local s = {0x61707865, 0x3320646e, 0x79622d32, 0x6b206574}
  for i = 1, 8 do s[4 + i] = key[i] end
  for i = 1, 4 do s[12 + i] = tail[i] end
  local start = {}
  for i = 1, 16 do start[i] = s[i] end
  for _ = 1, 10 do
    quarter(s, 1, 5, 9, 13) quarter(s, 2, 6, 10, 14) quarter(s, 3, 7, 11, 15) quarter(s, 4, 8, 12, 16)
    quarter(s, 1, 6, 11, 16) quarter(s, 2, 7, 12, 13) quarter(s, 3, 8, 9, 14) quarter(s, 4, 5, 10, 15)
  end
  return s, start
end

-- One block of the key stream after another; key: 32 bytes, nonce: 24 bytes.
local function key_stream(key, nonce)
  local n = words_of(nonce)
  local s = rounds(words_of(key), {n[1], n[2], n[3], n[4]})
  local subkey = {s[1], s[2], s[3], s[4], s[13], s[14], s[15], s[16]}
  return function(number)
    local block, start = rounds(subkey, {number, 0, n[5], n[6]})
    local bytes = {}
    for i = 0, 63 do
      local k = math.floor(i / 4) + 1
      local word = (block[k] + start[k]) % 0x100000000
      bytes[i + 1] = band(rshift(word, 8 * (i % 4)), 0xff)
    end
    return bytes
  end
end

-- The first block of the stream is the tag's.
local function decipher(stream, text)
  local out = {}
  for at = 1, #text, 64 do
    local block = stream(1 + (at - 1) / 64)
    for i = at, math.min(at + 63, #text) do
      out[i] = string.char(bxor(text:byte(i), block[i - at + 1]))
    end
  end
  return table.concat(out)
end

-- --- Poly1305 (RFC 8439): numbers below 2^130 as ten limbs of 13 bits, lowest first ------------

-- `size` bits from bit `at` of the digits, each of `digit_bits` bits.
local function bits_of(digits, digit_bits, at, size)
  local first, shift = math.floor(at / digit_bits), at % digit_bits
  local value, weight = 0, 1
  for i = first, math.floor((at + size - 1) / digit_bits) do
    value = value + (digits[i + 1] or 0) * weight
    weight = weight * 2 ^ digit_bits
  end
  return math.floor(value / 2 ^ shift) % 2 ^ size
end

local function limbs_of(bytes)
  local limbs = {}
  for i = 1, 10 do limbs[i] = bits_of(bytes, 8, 13 * (i - 1), 13) end
  return limbs
end

-- Every limb below 2^13 again; what is above 2^130 comes in as five times that.
local function carry(limbs)
  local over = 0
  for i = 1, 10 do
    local value = limbs[i] + over
    limbs[i], over = value % 8192, math.floor(value / 8192)
  end
  limbs[1] = limbs[1] + 5 * over
end

local function times(a, b)
  local product = {0, 0, 0, 0, 0, 0, 0, 0, 0, 0}
  for i = 1, 10 do
    for k = 1, 10 do
      local at, factor = i + k - 1, 1
      if at > 10 then at, factor = at - 10, 5 end
      product[at] = product[at] + factor * a[i] * b[k]
    end
  end
  carry(product)
  return product
end

-- The tag (16 bytes) of a text whose length is a multiple of 16; key: 32 bytes as numbers.
local function poly1305(key, text)
  local r = {unpack(key, 1, 16)}
  for _, i in ipairs({4, 8, 12, 16}) do r[i] = band(r[i], 15) end
  for _, i in ipairs({5, 9, 13}) do r[i] = band(r[i], 252) end
  r = limbs_of(r)
  local sum = limbs_of({})
  for at = 1, #text, 16 do
    local block = {text:byte(at, at + 15)}
    block[17] = 1
    local limbs = limbs_of(block)
    for i = 1, 10 do sum[i] = sum[i] + limbs[i] end
    sum = times(sum, r)
  end
  carry(sum) carry(sum)
  local reduced = {unpack(sum)}  -- the sum less 2^130 - 5, if it is as large
  reduced[1] = reduced[1] + 5
  local over = 0
  for i = 1, 10 do
    local value = reduced[i] + over
    reduced[i], over = value % 8192, math.floor(value / 8192)
  end
  if over > 0 then sum = reduced end
  local tag = {}
  over = 0
  for i = 0, 15 do
    local value = bits_of(sum, 13, 8 * i, 8) + key[17 + i] + over
    tag[i + 1], over = string.char(value % 256), math.floor(value / 256)
  end
  return table.concat(tag)
end

local function padded(text) return text .. string.rep("\0", -#text % 16) end

local function length_bytes(length)
  return string.char(length % 256, math.floor(length / 256)) .. string.rep("\0", 6)
end

-- --- Keys -------------------------------------------------------------------------------------

local keys, keys_from = {}, nil

local function key_of(robot)
  if keys_from ~= ivfm.prefs.keys then
    keys, keys_from = {}, ivfm.prefs.keys
    local file = keys_from ~= "" and io.open(keys_from, "r")
    if file then
      for line in file:lines() do
        local number, hex = line:match("^(%d+) (%x+)%s*$")
        if number and #hex == 64 then
          keys[tonumber(number)] = hex:gsub("%x%x", function(h) return string.char(tonumber(h, 16)) end)
        end
      end
      file:close()
    end
  end
  return keys[robot]
end

-- --- Checks -----------------------------------------------------------------------------------

local kMostBoots = 8
local boots = {}  -- robot and direction -> the boots of who sends so, newest first

local function boots_of(robot, direction)
  local at = robot * 2 + direction
  boots[at] = boots[at] or {}
  return boots[at]
end

local function note_boot(robot, direction, boot)
  local list = boots_of(robot, direction)
  for _, known in ipairs(list) do
    if known == boot then return end
  end
  table.insert(list, 1, boot)
  list[kMostBoots + 1] = nil
end

local function crc32(bytes)
  local crc = 0xffffffff
  for i = 1, #bytes do
    crc = bxor(crc, bytes:byte(i))
    for _ = 1, 8 do crc = bxor(rshift(crc, 1), band(crc, 1) == 1 and 0xedb88320 or 0) end
  end
  return bxor(crc, 0xffffffff)
end

-- Whether `expected(context)` is the trailer for the receiver's boot.
local function check(bytes, robot, direction, trailer, expected)
  note_boot(robot, direction, bytes:sub(13, 20))
  local unbound = band(bytes:byte(2), 2) ~= 0
  local candidates = unbound and {string.rep("\0", 8)} or boots_of(robot, 1 - direction)
  for _, boot in ipairs(candidates) do
    if expected(string.char(direction) .. boot) == trailer then return "good" end
  end
  return #candidates == 0 and "not possible: the recording lacks the receiver's boot" or "wrong"
end

-- What is not encrypted: whether its checksum is right. The kind tells the direction.
local function check_plain(bytes, robot)
  local direction = bytes:byte(21) >= 0x80 and 1 or 0
  return check(bytes, robot, direction, bytes:sub(-4), function(context)
    local crc = crc32(bytes:sub(1, -5) .. context)
    return string.char(band(crc, 255), band(rshift(crc, 8), 255), band(rshift(crc, 16), 255),
      rshift(crc, 24))
  end)
end

-- Kind and body in the clear, and whether the tag is right; nil without the key. The direction is
-- not sent: it is the one whose tag is right, or else the first whose kind is one of its own (the
-- wrong key stream makes such a kind once in forty datagrams).
local function decrypted(bytes, robot)
  local key = key_of(robot)
  if not key then return nil end
  local sealed = bytes:sub(21, -17)
  local likely, verdict
  for direction = 0, 1 do
    local nonce = bytes:sub(3, 20) .. string.char(direction) .. string.rep("\0", 5)
    local stream = key_stream(key, nonce)
    local text = decipher(stream, sealed)
    local kind = text:byte(1)
    if kinds[kind] and (kind >= 0x80) == (direction == 1) then
      local tag_key = stream(0)
      local found = check(bytes, robot, direction, bytes:sub(-16), function(context)
        local associated = bytes:sub(1, 20) .. context
        return poly1305(tag_key, padded(associated) .. padded(sealed) ..
          length_bytes(#associated) .. length_bytes(#sealed))
      end)
      if found == "good" then return text, found end
      if not likely then likely, verdict = text, found end
    end
  end
  return likely, verdict
end

-- --- Messages ---------------------------------------------------------------------------------

local function half(raw)
  local sign = raw >= 0x8000 and -1 or 1
  local exponent, fraction = band(rshift(raw, 10), 31), band(raw, 1023)
  if exponent == 0 then return sign * fraction * 2 ^ -24 end
  if exponent == 31 then return fraction == 0 and sign * math.huge or 0 / 0 end
  return sign * (1 + fraction / 1024) * 2 ^ (exponent - 15)
end

-- Walks through the content. Every take() adds a field; reading beyond the end is an error.
local Reader = {}
Reader.__index = Reader

local function reader(tvb) return setmetatable({tvb = tvb, at = 0}, Reader) end
function Reader:left() return self.tvb:len() - self.at end
function Reader:range(size)
  if self:left() < size then error("short") end
  local range = self.tvb(self.at, size)
  self.at = self.at + size
  return range
end
function Reader:take(tree, field, size)
  local range = self:range(size)
  tree:add_le(field, range)
  return range
end
function Reader:halves(tree, fields)
  for _, field in ipairs(fields) do
    local range = self:range(2)
    tree:add(field, range, half(range:le_uint()))
  end
end
function Reader:pose(tree) self:halves(tree, {f.x, f.y, f.heading}) end

-- Bits from the lowest of each byte upwards.
local function bit_reader(range)
  local position = 0
  return function(count)
    local value = 0
    for i = 0, count - 1 do
      local byte = math.floor(position / 8)
      if byte >= range:len() then error("short") end
      value = value + band(rshift(range(byte, 1):uint(), position % 8), 1) * 2 ^ i
      position = position + 1
    end
    return value
  end, function() return math.ceil(position / 8) end
end

-- The symbols of a block: how many bytes they take, and themselves.
local function symbols_of(range, coding, bits, count)
  local symbols = {}
  if coding == 0 then
    for i = 0, count - 1 do symbols[#symbols + 1] = range(i, 1):uint() end
    return count, symbols
  end
  local take, used = bit_reader(range)
  while #symbols < count do
    local symbol, length = take(bits), 1
    if coding == 2 or coding == 4 then
      local zeros = 0
      while take(1) == 0 do zeros = zeros + 1 end
      length = 2 ^ zeros + take(zeros)
    end
    for _ = 1, length do symbols[#symbols + 1] = symbol end
  end
  if #symbols > count then error("long") end
  return used(), symbols
end

local function cells_text(symbols, coding, width)
  if coding >= 3 then  -- differences to the row below
    for i, symbol in ipairs(symbols) do
      local difference = symbol % 2 == 1 and -(symbol + 1) / 2 or symbol / 2
      symbols[i] = ((symbols[i - width] or 0) + difference) % 256
    end
  end
  local rows = {}
  for i = 1, #symbols, width do
    rows[#rows + 1] = table.concat(symbols, " ", i, math.min(i + width - 1, #symbols))
  end
  return table.concat(rows, " / ")
end

function Reader:region(tree)
  local from = self.at
  local sub = tree:add(f.region, self.tvb(from, 1))
  local layer = self:take(sub, f.layer, 1):uint()
  local x, y = self:take(sub, f.column, 3):le_int(), self:take(sub, f.row, 3):le_int()
  local width, height = self:take(sub, f.width, 1):uint(), self:take(sub, f.height, 1):uint()
  local head = self:take(sub, f.coding, 1):uint()
  local coding, bits = band(head, 7), rshift(head, 3)
  if not codings[coding] or width * height == 0 or width * height > 4096 then error("region") end
  local size, symbols = 0, {}
  if width * height > 0 and not (coding ~= 0 and bits == 0 and (coding == 2 or coding == 4)) then
    if bits == 0 and coding ~= 0 then
      for i = 1, width * height do symbols[i] = 0 end
    else
      size, symbols = symbols_of(self.tvb(self.at), coding, bits, width * height)
    end
  end
  if size > 0 then
    sub:add(f.cells, self.tvb(self.at, size), cells_text(symbols, coding, width))
  end
  self.at = self.at + size
  sub:set_len(self.at - from)
  sub:append_text(string.format(": %s, %d x %d cells from (%d, %d)", layers[layer] or "?", width,
    height, x, y))
end

function Reader:map_update(tree)
  self:take(tree, f.cell_um, 3)
  self:pose(tree)
  local regions = 0
  while self:left() > 0 do
    self:region(tree)
    regions = regions + 1
  end
  return regions .. (regions == 1 and " region" or " regions")
end

function Reader:window(tree)
  self:take(tree, f.column, 3) self:take(tree, f.row, 3)
  self:take(tree, f.width, 2) self:take(tree, f.height, 2)
end

function Reader:cursor(tree)
  self:take(tree, f.layer, 1) self:take(tree, f.row, 3) self:take(tree, f.column, 3)
end

function Reader:acknowledgement(tree)
  local newest = self:take(tree, f.newest, 4):le_uint()
  if self:left() > 0 then self:take(tree, f.earlier, self:left()) end
  return "up to " .. newest
end

function Reader:hello(tree)
  self:take(tree, f.cell_um, 3)
  self:window(tree)
  self:take(tree, f.flags, 1)
  local length = self:range(1):uint()
  local name = length > 0 and self:take(tree, f.name, length):string() or ""
  return name
end

function Reader:status(tree)
  self:pose(tree)
  local state = self:take(tree, f.state, 1):uint()
  self:take(tree, f.fault, 1)
  self:take(tree, f.column, 3) self:take(tree, f.row, 3)
  for _, field in ipairs({f.uptime_ms, f.actions, f.distance_mm, f.decision_us, f.sent, f.again}) do
    self:take(tree, field, 4)
  end
  return states[state] or "?"
end

function Reader:found(tree)
  self:pose(tree)
  self:take(tree, f.target_x_um, 4) self:take(tree, f.target_y_um, 4)
end

function Reader:command(tree)
  local code = self:take(tree, f.command, 1):uint()
  self:take(tree, f.revision, 4)
  return commands[code]
end

function Reader:welcome(tree)
  self:take(tree, f.new_epoch, 4) self:take(tree, f.flags, 1)
end

function Reader:restore_request(tree)
  self:window(tree)
  self:cursor(tree)
end

function Reader:restore(tree)
  self:cursor(tree)
  self:cursor(tree)
  return self:map_update(tree)
end

function Reader:places(tree)
  while self:left() > 0 do
    self:halves(tree, {f.x, f.y})
    self:take(tree, f.age, 1)
  end
end

function Reader:map_frame(tree)
  self:take(tree, f.new_epoch, 4)
  self:take(tree, f.frame_x_um, 4) self:take(tree, f.frame_y_um, 4)
  self:take(tree, f.frame_heading, 2)
end

local messages = {
  [0x01] = Reader.map_update, [0x02] = Reader.acknowledgement, [0x03] = Reader.hello,
  [0x04] = Reader.status, [0x05] = Reader.found, [0x06] = Reader.restore_request,
  [0x81] = Reader.map_update, [0x82] = Reader.acknowledgement, [0x83] = Reader.command,
  [0x84] = Reader.welcome, [0x85] = Reader.restore,
  [0x86] = Reader.places, [0x87] = Reader.map_frame,
}

local function dissect_content(content, tree, info)
  local read = reader(content)
  local kind = read:take(tree, f.kind, 1):uint()
  info[#info + 1] = kinds[kind] or "unknown kind"
  if not messages[kind] then
    tree:add_proto_expert_info(damaged)
    return
  end
  local fine, more = pcall(messages[kind], read, tree)
  if fine and more then info[#info + 1] = more end
  if not fine or read:left() > 0 then
    tree:add_proto_expert_info(damaged)
    if read:left() > 0 then tree:add(f.rest, content(read.at)) end
  end
end

function ivfm.dissector(tvb, packet, root)
  local flags = tvb:len() >= 25 and tvb(1, 1):uint() or 0
  if tvb:len() < 25 or tvb(0, 1):uint() ~= 0x49 or rshift(flags, 4) ~= 2 then return 0 end
  local encrypted = band(flags, 1) == 1
  local trailer = encrypted and 16 or 4
  if tvb:len() < 21 + trailer then return 0 end
  local tree = root:add(ivfm, tvb())
  for _, field in ipairs({f.version, f.unbound, f.encrypted}) do tree:add(field, tvb(1, 1)) end
  tree:add_le(f.robot, tvb(2, 2)) tree:add_le(f.epoch, tvb(4, 4))
  tree:add_le(f.sequence, tvb(8, 4)) tree:add_le(f.boot, tvb(12, 8))
  local robot = tvb(2, 2):le_uint()
  local info = {"Robot " .. robot .. " #" .. tvb(8, 4):le_uint()}
  local content, verdict = tvb(20, tvb:len() - 20 - trailer):tvb(), nil
  if encrypted then
    local text
    text, verdict = decrypted(tvb:raw(), robot)
    content = text and ByteArray.new(text, true):tvb("Decrypted") or nil
  else
    verdict = check_plain(tvb:raw(), robot)
  end
  if content then
    dissect_content(content, tree, info)
  else
    info[#info + 1] = "encrypted"
    tree:add_proto_expert_info(locked)
  end
  tree:add(f.trailer, tvb(tvb:len() - trailer))
  if verdict then tree:add(f.check, tvb(tvb:len() - trailer), verdict) end
  if verdict == "wrong" then
    tree:add_proto_expert_info(forged)
    info[#info + 1] = "wrong trailer"
  end
  packet.cols.protocol = "ivfm"
  packet.cols.info = table.concat(info, ", ")
  return tvb:len()
end

ivfm:register_heuristic("udp", function(tvb, packet, root)
  return ivfm.dissector(tvb, packet, root) > 0
end)
