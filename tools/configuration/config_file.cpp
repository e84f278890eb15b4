#include "tools/configuration/config_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>

namespace ledgerline::configuration {
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

}  // namespace

class ConfigFile::Writer {
 public:
  Writer(const std::vector<KeyDescription>& keys, const ConfigFile& file) : keys_(keys), file_(file) {}

  void write_table(const std::string& table) {
    const std::size_t count = table.starts_with("[[") ? file_.count_of(table) : 1;
    text_ += "\n";
    for (const KeyDescription& key : keys_)
      if (key.table == table && key.key.empty()) text_ += comment(key.about);
    if (count == 0) return write_table(table, 0, "# " + table + "\n", true);
    for (std::size_t index = 0; index < count; ++index)
      write_table(table, index, fmt::format("{}{}\n", index > 0 ? "\n" : "", table), index == 0);
  }
  std::string text() { return std::move(text_); }

 private:
  void write_table(const std::string& table, std::size_t index, const std::string& heading, bool with_words) {
    if (!table.empty()) text_ += heading;
    for (const KeyDescription& key : keys_) {
      if (key.table != table || key.key.empty()) continue;
      if (with_words) text_ += about(key);
      const auto value = std::find_if(file_.values_.begin(), file_.values_.end(), [&](const Value& one) {
        return one.table == table && one.index == index && one.key == key.key;
      });
      if (value != file_.values_.end())
        text_ += fmt::format("{} = {}\n", key.key, value->value);
      else if (with_words)
        text_ += fmt::format("# {} ={}\n", key.key, is_toml(key.usual) ? " " + key.usual : "");
    }
  }

  const std::vector<KeyDescription>& keys_;
  const ConfigFile& file_;
  std::string text_;
};

std::string toml(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < ' ' || c == '\x7f') {
      out += fmt::format("\\u{:04X}", static_cast<unsigned char>(c));
      continue;
    }
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

void ConfigFile::add(std::string table, std::string key, std::string value, std::size_t index) {
  values_.push_back({std::move(table), index, std::move(key), std::move(value)});
}
void ConfigFile::text(std::string table, std::string key, std::string_view value, std::size_t index) {
  add(std::move(table), std::move(key), toml(value), index);
}
void ConfigFile::number(std::string table, std::string key, double value, int digits, std::size_t index) {
  add(std::move(table), std::move(key), fmt::format("{:.{}f}", value, digits), index);
}
void ConfigFile::number(std::string table, std::string key, int value, std::size_t index) {
  add(std::move(table), std::move(key), std::to_string(value), index);
}
void ConfigFile::append(std::string_view toml) { appended_ += fmt::format("\n{}", toml); }

std::size_t ConfigFile::count_of(const std::string& table) const {
  std::size_t count = 0;
  for (const Value& value : values_)
    if (value.table == table) count = std::max(count, value.index + 1);
  return count;
}

std::string ConfigFile::plain() const {
  std::vector<std::pair<std::string, std::string>> tables{{"", ""}};  // TOML: what has no table stands before all
  for (const Value& value : values_) {
    const std::string name = fmt::format("{} {}", value.table, value.index);
    auto at = std::find_if(tables.begin(), tables.end(),
                           [&](const auto& one) { return value.table.empty() || one.first == name; });
    if (at == tables.end()) at = tables.insert(at, {name, fmt::format("\n{}\n", value.table)});
    at->second += fmt::format("{} = {}\n", value.key, value.value);
  }
  std::string text;
  for (const auto& table : tables) text += table.second;
  return text + appended_;
}

Result<std::string> ConfigFile::commented(const std::string& heading, const std::vector<KeyDescription>& keys) const {
  for (const Value& value : values_) {
    const bool known = std::any_of(keys.begin(), keys.end(), [&](const KeyDescription& key) {
      return key.table == value.table && key.key == value.key;
    });
    if (!known) return Error{fmt::format("there is no key {} in {}", value.key, value.table)};
    for (std::size_t index = 0; index < value.index; ++index) {
      if (std::none_of(values_.begin(), values_.end(),
                       [&](const Value& other) { return other.table == value.table && other.index == index; }))
        return Error{fmt::format("{} has no values at index {}", value.table, index)};
    }
  }
  std::vector<std::string> tables;
  for (const KeyDescription& key : keys)
    if (std::find(tables.begin(), tables.end(), key.table) == tables.end()) tables.push_back(key.table);
  // TOML: what has no table stands before all tables.
  std::stable_partition(tables.begin(), tables.end(), [](const std::string& table) { return table.empty(); });
  Writer writer(keys, *this);
  for (const std::string& table : tables) writer.write_table(table);
  return comment(heading) + writer.text();
}

void add_server(ConfigFile& file, const std::string& table, const Server& server, std::size_t index) {
  file.text(table, "endpoint", server.endpoint, index);
  file.text(table, "tls_ca", server.tls_ca, index);
  if (!server.server_name.empty()) file.text(table, "server_name", server.server_name, index);
}

void add_ledger(ConfigFile& file, const LedgerAccess& access) {
  const auto text = [&](const char* key, const std::string& value) {
    if (!value.empty()) file.text("[ledger]", key, value);
  };
  add_server(file, "[ledger]", access.peer);
  text("tls_certificate", access.tls_certificate);
  text("tls_key", access.tls_key);
  text("channel", access.channel);
  text("contract", access.contract);
  text("msp_id", access.msp_id);
  text("msp_dir", access.msp_dir);
  text("config_block", access.config_block);
  if (access.timeouts.deadline_ns != deployment::Timeouts{}.deadline_ns)
    file.number("[ledger]", "deadline_ms", to_ms(access.timeouts.deadline_ns), 0);
  for (std::size_t i = 0; i < access.orderers.size(); ++i) add_server(file, "[[orderer]]", access.orderers[i], i);
  for (std::size_t i = 0; i < access.endorsers.size(); ++i) {
    file.text("[[endorser]]", "msp_id", access.endorsers[i].msp_id, i);
    add_server(file, "[[endorser]]", access.endorsers[i], i);
  }
  for (std::size_t i = 0; i < access.msps.size(); ++i) {
    file.text("[[msp]]", "id", access.msps[i].first, i);
    file.text("[[msp]]", "ca", access.msps[i].second, i);
  }
}

void add_timeouts(ConfigFile& file, const deployment::Timeouts& timeouts) {
  const deployment::Timeouts usual;
  if (timeouts.max_age_ns == usual.max_age_ns && timeouts.silent_after_ns == usual.silent_after_ns) return;
  file.number("[check]", "max_age_ms", to_ms(timeouts.max_age_ns), 0);
  file.number("[agent]", "ledger_silent_after_ms", to_ms(timeouts.silent_after_ns), 0);
}

}  // namespace ledgerline::configuration
