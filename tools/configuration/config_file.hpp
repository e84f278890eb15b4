#pragma once
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/config/config.hpp"
#include "tools/deployment/deployment.hpp"

/// The config files that `ledgerline init` and `ledgerline fly` write for the other programs. Pure.
/// The reference of every key of every program, docs/configuration.md, made from the readers: each reads a describing
/// Config (common/config), so a key cannot be in a program and not on the page.
namespace ledgerline::configuration {

/// "\"raven\"", as TOML writes a text.
std::string toml(std::string_view text);

/// Values for the keys of one file.
class ConfigFile {
 public:
  /// `table`: "[ledger]", "[[drone]]"; empty: the top of the file. `index`: which [[table]] of that name. `value`:
  /// TOML.
  void add(std::string table, std::string key, std::string value, std::size_t index = 0);
  void text(std::string table, std::string key, std::string_view value, std::size_t index = 0);
  /// With this many digits behind the point.
  void number(std::string table, std::string key, double value, int digits, std::size_t index = 0);
  void number(std::string table, std::string key, int value, std::size_t index = 0);
  /// Tables of another file, as they stand there.
  void append(std::string_view toml);

  /// The values alone, tables in the order in which they were added.
  std::string plain() const;
  /// For a person who goes on with it: every key that its program reads, in the words of the reference
  /// (docs/configuration.md). `keys`: of the file, in the reader's order. A key without a value stands there as a
  /// comment with its default; so does a whole [[table]] that has none. The comments of a [[table]] are at its first
  /// one alone. What was appended is not in it. An error: a value of a key that the program does not read, or a
  /// [[table]] whose indices have a gap.
  Result<std::string> commented(const std::string& heading, const std::vector<KeyDescription>& keys) const;

 private:
  struct Value {
    std::string table;
    std::size_t index;
    std::string key, value;
  };
  class Writer;
  std::size_t count_of(const std::string& table) const;

  std::vector<Value> values_;
  std::string appended_;
};

/// A peer or an orderer.
struct Server {
  std::string msp_id;         ///< of a peer
  std::string endpoint;       ///< HOST:PORT
  std::string server_name{};  ///< in its certificate; empty: the endpoint's host
  std::string tls_ca{};       ///< file
};
void add_server(ConfigFile& file, const std::string& table, const Server& server, std::size_t index = 0);

/// How a program reaches the ledger. What is empty is left out of its config.
struct LedgerAccess {
  Server peer;                               ///< of the own organisation
  std::string tls_certificate{}, tls_key{};  ///< that it shows to servers
  std::string channel{}, contract{}, msp_id, msp_dir, config_block{};
  std::vector<Server> orderers{}, endorsers{};              ///< for the direct path
  std::vector<std::pair<std::string, std::string>> msps{};  ///< MSP id and its authority's file
  deployment::Timeouts timeouts{};
};
void add_ledger(ConfigFile& file, const LedgerAccess& access);
/// Agent's, where it must wait longer than usual.
void add_timeouts(ConfigFile& file, const deployment::Timeouts& timeouts);

/// The keys of one file, or of tables that several files have.
struct Part {
  std::string name;                  ///< "agent", "the ledger"
  std::string words;                 ///< what the file is and who reads it; Markdown
  std::vector<std::string> shared;   ///< names of the parts whose tables it has, too
  std::vector<KeyDescription> keys;  ///< its own, in the reader's order
};

/// All of them; what several files share comes last.
std::vector<Part> parts();

/// Has the readers of a program ("agent") read its file: the keys, as at its start. What else it loads, such as keys
/// and certificates, is not checked.
Status check(const std::string& part, Config& config);

/// One part, or the whole page, as Markdown.
std::string show(const Part& part);
std::string page();

}  // namespace ledgerline::configuration
