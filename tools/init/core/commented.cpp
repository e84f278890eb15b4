#include "tools/init/core/commented.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

namespace ledgerline::init {
namespace {

constexpr std::size_t max_columns = 100;

std::string comment(const std::string& words) {
  std::string text, line = "#", word;
  std::istringstream in(words);
  while (in >> word) {
    if (line.size() + 1 + word.size() > max_columns && line.size() > 1) {
      text += line + "\n";
      line = "#";
    }
    line += " " + word;
  }
  return line.size() > 1 ? text + line + "\n" : text;
}

// Of a default: the reference has words for those that are no value.
bool is_toml(const std::string& usual) {
  return !usual.empty() &&
         (usual == "true" || usual == "false" || usual == "[]" ||
          std::string_view("\"-0123456789").find(usual[0]) != std::string_view::npos ||
          (usual[0] == '[' && usual.size() > 1 && std::isdigit(static_cast<unsigned char>(usual[1]))) ||
          usual.starts_with("[-"));
}

std::string about(const KeyDescription& key) {
  std::string words = key.about.empty() ? key.type : fmt::format("{} ({})", key.about, key.type);
  if (!key.allowed.empty()) words += fmt::format("; {}", key.allowed);
  if (key.usual.empty()) return comment(words + "; must be there");
  return comment(is_toml(key.usual) ? words : fmt::format("{}; default: {}", words, key.usual));
}

class Writer {
 public:
  Writer(const std::vector<KeyDescription>& keys, const std::vector<Value>& values) : keys_(keys), values_(values) {}

  void write_table(const std::string& table) {
    const bool repeated = table.starts_with("[[");
    const std::size_t places = repeated ? places_of(table) : 1;
    text_ += "\n";
    for (const KeyDescription& key : keys_)
      if (key.table == table && key.key.empty()) text_ += comment(key.about);
    if (places == 0) return write_place(table, 0, "# " + table + "\n", true);
    for (std::size_t place = 0; place < places; ++place)
      write_place(table, place, fmt::format("{}{}\n", place > 0 ? "\n" : "", table), place == 0);
  }
  std::string take() { return std::move(text_); }

  std::size_t places_of(const std::string& table) const {
    std::size_t places = 0;
    for (const Value& value : values_)
      if (value.table == table) places = std::max(places, value.place + 1);
    return places;
  }

 private:
  void write_place(const std::string& table, std::size_t place, const std::string& heading, bool with_words) {
    if (!table.empty()) text_ += heading;
    for (const KeyDescription& key : keys_) {
      if (key.table != table || key.key.empty()) continue;
      const Value* value = find(table, place, key.key);
      if (with_words) text_ += about(key);
      if (value)
        text_ += fmt::format("{} = {}\n", key.key, value->value);
      else if (with_words)
        text_ += fmt::format("# {} ={}\n", key.key, is_toml(key.usual) ? " " + key.usual : "");
    }
  }
  const Value* find(const std::string& table, std::size_t place, const std::string& key) const {
    const auto found = std::find_if(values_.begin(), values_.end(), [&](const Value& value) {
      return value.table == table && value.place == place && value.key == key;
    });
    return found == values_.end() ? nullptr : &*found;
  }

  const std::vector<KeyDescription>& keys_;
  const std::vector<Value>& values_;
  std::string text_;
};

}  // namespace

std::string toml(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

Result<std::string> commented(const std::string& heading, const std::vector<KeyDescription>& keys,
                              const std::vector<Value>& values) {
  Writer writer(keys, values);
  for (const Value& value : values) {
    const bool known = std::any_of(keys.begin(), keys.end(), [&](const KeyDescription& key) {
      return key.table == value.table && key.key == value.key;
    });
    if (!known) return Error{fmt::format("there is no key {} in {}", value.key, value.table)};
    for (std::size_t place = 0; place < writer.places_of(value.table); ++place) {
      if (std::none_of(values.begin(), values.end(),
                       [&](const Value& other) { return other.table == value.table && other.place == place; }))
        return Error{fmt::format("{} has no values at place {}", value.table, place)};
    }
  }
  std::vector<std::string> tables;
  for (const KeyDescription& key : keys)
    if (std::find(tables.begin(), tables.end(), key.table) == tables.end()) tables.push_back(key.table);
  // TOML: what has no table stands before all tables.
  std::stable_partition(tables.begin(), tables.end(), [](const std::string& table) { return table.empty(); });
  for (const std::string& table : tables) writer.write_table(table);
  return comment(heading) + writer.take();
}

}  // namespace ledgerline::init
