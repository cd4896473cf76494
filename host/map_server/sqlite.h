// The little of SQLite that the run database needs: a connection and statements that close
// themselves.
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace ivfm::host {

// What SQLite said, in one sentence that names the file.
class DatabaseError : public std::runtime_error {
 public:
  DatabaseError(const std::string& message, int code) : std::runtime_error(message), code_(code) {}
  int code() const { return code_; }  // SQLITE_BUSY, SQLITE_NOTADB ...

 private:
  int code_;
};

class SqliteConnection {
 public:
  enum class Mode { kRead, kWrite };
  // Throws DatabaseError. kWrite creates the file when there is none.
  SqliteConnection(const std::filesystem::path& path, Mode mode);

  // Runs SQL without results. Throws DatabaseError.
  void execute(const char* sql);
  // The first column of the first row; nothing when there is no row or it is NULL.
  std::optional<std::int64_t> integer(const char* sql);
  sqlite3* handle() { return handle_.get(); }
  [[noreturn]] void fail(int code);

 private:
  struct Close {
    void operator()(sqlite3* handle) const { sqlite3_close_v2(handle); }
  };
  std::string path_;
  std::unique_ptr<sqlite3, Close> handle_;
};

// A prepared statement. bind() the parameters in order, then run() or row(). Throws DatabaseError.
class SqliteStatement {
 public:
  SqliteStatement(SqliteConnection& connection, const char* sql);

  SqliteStatement& bind(std::int64_t value);
  SqliteStatement& bind(double value);
  SqliteStatement& bind(std::string_view value);
  SqliteStatement& bind(std::span<const std::uint8_t> value);
  SqliteStatement& bind_null();
  // Executes, and makes ready for the next bind().
  void run();
  // True when there is a (further) row to read; false ends, and makes ready for the next bind().
  bool row();

  int column_count() const;
  std::string column_name(int column) const;
  bool is_null(int column) const;
  bool is_blob(int column) const;
  std::int64_t integer(int column) const;
  double real(int column) const;
  std::string text(int column) const;
  // Valid until the next row().
  std::span<const std::uint8_t> blob(int column) const;

 private:
  void check(int code);
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  SqliteConnection& connection_;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  int bound_ = 0;
};

}  // namespace ivfm::host
