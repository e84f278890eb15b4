#include "tests/fuzz/mutator.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>

namespace ledgerline::fuzz {
namespace {

using Strings = std::vector<std::string>;

std::size_t below(Random& random, std::size_t n) { return n == 0 ? 0 : static_cast<std::size_t>(random.next() % n); }

template <typename List>
const auto& any_of(Random& random, const List& list) {
  return list[below(random, std::size(list))];
}

std::string random_bytes(Random& random, std::size_t most) {
  std::string bytes(below(random, most + 1), '\0');
  for (char& c : bytes) c = static_cast<char>(random.next());
  return bytes;
}

// At 1, 2, 4 or 8 bytes, in either byte order.
std::string interesting_integer(Random& random) {
  constexpr std::array<std::uint64_t, 16> values{0,
                                                 1,
                                                 0x7f,
                                                 0x80,
                                                 0xff,
                                                 0x7fff,
                                                 0x8000,
                                                 0xffff,
                                                 0x7fffffff,
                                                 0x80000000,
                                                 0xffffffff,
                                                 0x7fffffffffffffff,
                                                 0x8000000000000000,
                                                 0xffffffffffffffff,
                                                 0x7ff0000000000000 /* infinity */,
                                                 0x7ff8000000000000 /* not a number */};
  const std::uint64_t value = any_of(random, values);
  const std::size_t size = std::size_t{1} << below(random, 4);
  std::string bytes;
  for (std::size_t i = 0; i < size; ++i) bytes += static_cast<char>(value >> (8 * i));
  if (random.next() % 2 == 0) std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

void overwrite(std::string& bytes, std::size_t at, const std::string& with) {
  bytes.replace(at, std::min(with.size(), bytes.size() - at), with);
}

// A byte or four that look like a length: a little more, a little less, far too much.
void change_length(Random& random, std::string& bytes) {
  const std::size_t at = below(random, bytes.size());
  constexpr std::array<int, 6> steps{-2, -1, 1, 2, 16, 127};
  if (random.next() % 4 == 0) {
    overwrite(bytes, at,
              any_of(random, std::array<std::string, 4>{std::string(4, '\xff'), "\xff\xff\xff\xff\x07",
                                                        "\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01",
                                                        std::string("\x00\x00\x00\x7f", 4)}));
  } else {
    bytes[at] = static_cast<char>(bytes[at] + any_of(random, steps));
  }
}

void change_bytes(Random& random, std::string& bytes, const Strings& seeds) {
  if (bytes.empty()) {
    bytes = random_bytes(random, 8);
    return;
  }
  const std::size_t at = below(random, bytes.size());
  const std::size_t some = 1 + below(random, std::min<std::size_t>(bytes.size() - at, 1 + below(random, 32)));
  switch (random.next() % 12) {
    case 0:
    case 1:
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(random, 8)));
      break;
    case 2:
      bytes[at] = static_cast<char>(random.next());
      break;
    case 3:
      bytes.insert(at, random_bytes(random, 8));
      break;
    case 4:
      bytes.erase(at, some);
      break;
    case 5:
      overwrite(bytes, at, interesting_integer(random));
      break;
    case 6:
      change_length(random, bytes);
      break;
    case 7:
      bytes.resize(at);
      break;
    case 8: {  // repeated, now and then very often
      const std::string part = bytes.substr(at, some);
      for (std::size_t n = random.next() % 16 == 0 ? 1000 : 1 + below(random, 4); n > 0; --n) bytes.insert(at, part);
      break;
    }
    case 9: {  // the front of this one, the back of another
      const std::string& other = any_of(random, seeds);
      bytes = bytes.substr(0, at) + other.substr(below(random, other.size() + 1));
      break;
    }
    case 10: {  // two parts change places
      const std::string part = bytes.substr(at, some);
      bytes.erase(at, some);
      bytes.insert(below(random, bytes.size() + 1), part);
      break;
    }
    default:
      bytes += random_bytes(random, 16);
      break;
  }
}

// ---- text

bool is_word(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '+' ||
         c == '.' || c == '_' || c == '?';
}

struct Part {
  std::size_t at, size;
};
std::vector<Part> words_of(const std::string& text) {
  std::vector<Part> words;
  for (std::size_t i = 0; i < text.size();) {
    std::size_t end = i;
    while (end < text.size() && is_word(text[end])) ++end;
    if (end > i) words.push_back({i, end - i});
    i = end + 1;
  }
  return words;
}

std::string repeat(const std::string& what, std::size_t times) {
  std::string text;
  for (std::size_t i = 0; i < times; ++i) text += what;
  return text;
}

std::string hostile_token(Random& random, Kind kind) {
  static const Strings any{"nan",
                           "inf",
                           "-inf",
                           "-0",
                           "+1",
                           "0x10",
                           "1e999999999",
                           "-1e308",
                           "1e-400",
                           "99999999999999999999",
                           "-9223372036854775808",
                           "9223372036854775808",
                           "18446744073709551615",
                           "18446744073709551616",
                           "2147483648",
                           "-2147483649",
                           "4294967295",
                           "65536",
                           "256",
                           "-1",
                           "0",
                           "00",
                           "1.",
                           ".5",
                           "1_000",
                           "true",
                           "null",
                           "",
                           std::string(1, '\0'),
                           "\xff",
                           "\xc0\x80",
                           "\xed\xa0\x80",
                           "\xf4\x90\x80\x80",
                           "\xe2\x82",
                           "\xef\xbb\xbf",
                           "\x1b[2J",
                           "\r\n",
                           "\\u0000",
                           "\\ud800",
                           "../../etc/passwd",
                           "%s%n",
                           "ok"};
  static const Strings json{"{",  "}",  "[",   "]",        "\"",        ":",          ",",
                            "{}", "[]", "NaN", "Infinity", "-Infinity", "\"\\uD800\""};
  static const Strings toml{"[",           "]",    "[[", "]]",          "\"\"\"", "'''",
                            "=",           "{",    "}",  "#",           "\n",     "1979-05-27T07:32:00Z",
                            "[[drone]]\n", "0b2",  "1e", "\\U00110000", ".",      "nan",
                            "-inf",        "9e307"};
  switch (random.next() % 8) {
    case 0:
      return std::string(1 + below(random, 400), "9-1.xA"[below(random, 6)]);
    case 1:
      return "0." + std::string(below(random, 400), '0') + "1";
    case 2:
    case 3:
      if (kind == Kind::json) {
        if (random.next() % 8 != 0) return any_of(random, json);
        return repeat(any_of(random, Strings{"[", "{\"a\":", "{\"assets\":["}), 1 + below(random, 3000));
      }
      if (kind == Kind::toml) {
        if (random.next() % 8 != 0) return any_of(random, toml);
        return repeat(any_of(random, Strings{"[", "{a=", "a.", "[[", "\"", "x=[{y="}), 1 + below(random, 3000));
      }
      return any_of(random, any);
    default:
      return any_of(random, any);
  }
}

void change_text(Random& random, std::string& text, const Strings& seeds, Kind kind) {
  const auto words = words_of(text);
  if (words.empty()) {
    text.insert(below(random, text.size() + 1), hostile_token(random, kind));
    return;
  }
  const Part word = any_of(random, words);
  switch (random.next() % 6) {
    case 0:
    case 1:
      text.replace(word.at, word.size, hostile_token(random, kind));
      break;
    case 2:
      text.insert(word.at + below(random, word.size + 1), hostile_token(random, kind));
      break;
    case 3:
      text.erase(word.at, word.size);
      break;
    case 4: {
      const std::string& other = any_of(random, seeds);
      const auto others = words_of(other);
      if (others.empty()) break;
      const Part from = any_of(random, others);
      text.replace(word.at, word.size, other.substr(from.at, from.size));
      break;
    }
    default: {  // a line twice, or gone
      const std::size_t begin = text.rfind('\n', word.at) == std::string::npos ? 0 : text.rfind('\n', word.at) + 1;
      const std::size_t end = std::min(text.find('\n', word.at), text.size() - 1) + 1;
      if (random.next() % 2 == 0) {
        text.insert(begin, text.substr(begin, end - begin));
      } else {
        text.erase(begin, end - begin);
      }
      break;
    }
  }
}

// ---- protobuf

struct Field {
  std::uint64_t tag = 0;
  std::string content;  ///< without the length of a length-delimited field
  bool delimited() const { return (tag & 7) == 2; }
};

std::optional<std::uint64_t> take_varint(std::string_view& bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < std::min<std::size_t>(bytes.size(), 10); ++i) {
    value |= static_cast<std::uint64_t>(bytes[i] & 0x7f) << (7 * i);
    if ((bytes[i] & 0x80) != 0) continue;
    bytes.remove_prefix(i + 1);
    return value;
  }
  return std::nullopt;
}

std::string varint(std::uint64_t value) {
  std::string bytes;
  for (; value >= 0x80; value >>= 7) bytes += static_cast<char>(value | 0x80);
  return bytes + static_cast<char>(value);
}

// nullopt: it is no message.
std::optional<std::vector<Field>> fields_of(std::string_view bytes) {
  std::vector<Field> fields;
  while (!bytes.empty()) {
    const auto tag = take_varint(bytes);
    if (!tag || *tag >> 3 == 0 || *tag >> 3 > 2000) return std::nullopt;
    std::size_t size = 0;
    const std::string_view before = bytes;
    switch (*tag & 7) {
      case 0:
        if (!take_varint(bytes)) return std::nullopt;
        size = before.size() - bytes.size();
        bytes = before;
        break;
      case 1:
        size = 8;
        break;
      case 2: {
        const auto length = take_varint(bytes);
        if (!length || *length > bytes.size()) return std::nullopt;
        size = static_cast<std::size_t>(*length);
        break;
      }
      case 5:
        size = 4;
        break;
      default:
        return std::nullopt;
    }
    if (size > bytes.size()) return std::nullopt;
    fields.push_back({*tag, std::string(bytes.substr(0, size))});
    bytes.remove_prefix(size);
  }
  return fields;
}

std::string bytes_of(const std::vector<Field>& fields) {
  std::string bytes;
  for (const Field& field : fields) {
    bytes += varint(field.tag);
    if (field.delimited()) bytes += varint(field.content.size());
    bytes += field.content;
  }
  return bytes;
}

std::string number_for(Random& random, const Field& field) {
  constexpr std::array<std::uint64_t, 8> numbers{0,          1,         0x7fffffff, 0x80000000,
                                                 0xffffffff, INT64_MAX, 1ULL << 63, ~0ULL};
  if ((field.tag & 7) == 0) return varint(any_of(random, numbers));
  std::string bytes = interesting_integer(random);
  bytes.resize(field.content.size());
  return bytes;
}

void change_message(Random& random, std::string& bytes, const Strings& seeds);

void change_field(Random& random, std::vector<Field>& fields, const Strings& seeds) {
  const std::size_t at = below(random, fields.size());
  switch (random.next() % 8) {
    case 0:
      fields.erase(fields.begin() + static_cast<std::ptrdiff_t>(at));
      break;
    case 1: {
      const Field copy = fields[at];
      const std::size_t times = random.next() % 16 == 0 ? 1100 : 1;
      if (copy.content.size() * times < max_input_bytes) fields.insert(fields.end(), times, copy);
      break;
    }
    case 2:
      fields[at].tag = (fields[at].tag & 7) | (1 + below(random, 12)) << 3;
      break;
    case 3:
      std::swap(fields[at], fields[below(random, fields.size())]);
      break;
    case 4:
      if (fields[at].delimited()) {
        fields[at].content = random.next() % 4 == 0 ? any_of(random, seeds) : hostile_token(random, Kind::text);
        break;
      }
      [[fallthrough]];
    default:
      if (fields[at].delimited()) {
        change_message(random, fields[at].content, seeds);
      } else {
        fields[at].content = number_for(random, fields[at]);
      }
  }
}

// Goes down into messages within messages; what is none is spoilt as bytes.
void change_message(Random& random, std::string& bytes, const Strings& seeds) {
  auto fields = fields_of(bytes);
  if (!fields || fields->empty() || random.next() % 16 == 0) {
    change_bytes(random, bytes, seeds);
    return;
  }
  change_field(random, *fields, seeds);
  bytes = bytes_of(*fields);
}

}  // namespace

std::string mutate(Random& random, const std::vector<std::string>& seeds, Kind kind) {
  std::string bytes = any_of(random, seeds);
  // Mostly one change, so that what is behind the first check is reached.
  for (int left = 6; left > 0; --left) {
    const bool plain = random.next() % 4 == 0;
    if (kind == Kind::bytes || plain) {
      change_bytes(random, bytes, seeds);
    } else if (kind == Kind::protobuf) {
      change_message(random, bytes, seeds);
    } else {
      change_text(random, bytes, seeds, kind);
    }
    if (random.next() % 2 == 0) break;
  }
  if (bytes.size() > max_input_bytes) bytes.resize(max_input_bytes);
  return bytes;
}

}  // namespace ledgerline::fuzz
