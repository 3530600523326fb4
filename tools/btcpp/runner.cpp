// Loads and ticks behaviour trees with BehaviorTree.CPP and reports what happened: the reference that
// tools/differential_trees.py and tools/btcpp_corpus.py compare with. README.md says what goes in and what comes out.
//
// One case is one line of JSON. Each case runs in a process of its own, so that a crash or an endless loop ends that
// case only.

#include <algorithm>
#include <csignal>
#include <cstring>
#include <iostream>
#include <string>
#include <tuple>
#include <vector>

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "behaviortree_cpp/bt_factory.h"
#include "behaviortree_cpp/contrib/json.hpp"

using Json = nlohmann::json;

namespace
{
constexpr unsigned SECONDS = 5;            // for one case
constexpr rlim_t MEMORY = 2UL << 30;       // bytes, for one case
constexpr size_t MOST_EVENTS = 20000;      // of one case; a tree that never returns fills the memory otherwise

Json* events = nullptr;  // of the tick that is under way

void note(Json event)
{
  if(events == nullptr)
  {
    return;
  }
  if(events->size() >= MOST_EVENTS)
  {
    raise(SIGXCPU);
  }
  events->push_back(std::move(event));
}

/// Number of a node: its place when the tree is written down, parents before children, from 0.
int number(const BT::TreeNode& node)
{
  return int(node.UID()) - 1;
}

/// The letters of a script, one a tick from the construction on, over and over: S, F or R.
class Letters
{
public:
  BT::NodeStatus next(BT::TreeNode& node)
  {
    const auto script = node.getInput<std::string>("script");
    if(!script || script->empty())
    {
      throw BT::RuntimeError("script: missing or empty");
    }
    const char letter = (*script)[ticks_ % script->size()];
    ticks_++;
    const auto& given = static_cast<const BT::TreeNode&>(node).config().output_ports;
    if(given.count("to") != 0)
    {
      check(node.setOutput<int>("to", ticks_));
    }
    if(given.count("say") != 0)
    {
      check(node.setOutput<std::string>("say", std::string(1, letter)));
    }
    return letter == 'S' ? BT::NodeStatus::SUCCESS :
           letter == 'F' ? BT::NodeStatus::FAILURE :
                           BT::NodeStatus::RUNNING;
  }

  static BT::PortsList ports()
  {
    return { BT::InputPort<std::string>("script"), BT::OutputPort("to"), BT::OutputPort("say") };
  }

private:
  int ticks_ = 0;

  static void check(const BT::Result& result)
  {
    if(!result)
    {
      throw BT::RuntimeError(result.error());
    }
  }
};

class Scripted : public BT::StatefulActionNode
{
public:
  using BT::StatefulActionNode::StatefulActionNode;

  static BT::PortsList providedPorts()
  {
    return Letters::ports();
  }

  BT::NodeStatus onStart() override
  {
    note({ "start", number(*this) });
    return letters_.next(*this);
  }

  BT::NodeStatus onRunning() override
  {
    return letters_.next(*this);
  }

  void onHalted() override
  {
    note({ "halt", number(*this) });
  }

private:
  Letters letters_;
};

class Check : public BT::ConditionNode
{
public:
  using BT::ConditionNode::ConditionNode;

  static BT::PortsList providedPorts()
  {
    return Letters::ports();
  }

  BT::NodeStatus tick() override
  {
    return letters_.next(*this);
  }

private:
  Letters letters_;
};

/// Reads the ports that are given, by their types, and notes the values.
class Typed : public BT::SyncActionNode
{
public:
  using BT::SyncActionNode::SyncActionNode;

  static BT::PortsList providedPorts()
  {
    return { BT::InputPort<int>("i"), BT::InputPort<double>("d"), BT::InputPort<bool>("b"),
             BT::InputPort<std::string>("s") };
  }

  BT::NodeStatus tick() override
  {
    read<int>("i");
    read<double>("d");
    read<bool>("b");
    read<std::string>("s");
    return BT::NodeStatus::SUCCESS;
  }

private:
  template <typename T>
  void read(const std::string& port)
  {
    if(config().input_ports.count(port) == 0)
    {
      return;
    }
    const auto value = getInput<T>(port);
    if(!value)
    {
      throw BT::RuntimeError(value.error());
    }
    note({ "read", number(*this), port, *value });
  }
};

// -- stubs of leaves that nobody knows ------------------------------------------------------------------------------

class StubAction : public BT::SyncActionNode
{
public:
  using BT::SyncActionNode::SyncActionNode;
  BT::NodeStatus tick() override
  {
    return BT::NodeStatus::SUCCESS;
  }
};

class StubCondition : public BT::ConditionNode
{
public:
  using BT::ConditionNode::ConditionNode;
  BT::NodeStatus tick() override
  {
    return BT::NodeStatus::SUCCESS;
  }
};

class StubControl : public BT::ControlNode
{
public:
  using BT::ControlNode::ControlNode;
  BT::NodeStatus tick() override
  {
    return BT::NodeStatus::SUCCESS;
  }
};

class StubDecorator : public BT::DecoratorNode
{
public:
  using BT::DecoratorNode::DecoratorNode;
  BT::NodeStatus tick() override
  {
    return child_node_->executeTick();
  }
};

template <typename T>
void registerStub(BT::BehaviorTreeFactory& factory, const Json& stub, BT::NodeType type)
{
  BT::PortsList ports;
  for(const auto& port : stub.at("ports"))
  {
    ports.insert(BT::BidirectionalPort(port.get<std::string>()));
  }
  const BT::TreeNodeManifest manifest = { type, stub.at("id").get<std::string>(), ports, {} };
  factory.registerBuilder(manifest, [](const std::string& name, const BT::NodeConfig& config) {
    return std::make_unique<T>(name, config);
  });
}

// -- one case ---------------------------------------------------------------------------------------------------------

Json valueOf(const BT::Any& any)
{
  if(any.empty())
  {
    return { { "type", "unset" } };
  }
  if(any.isString())
  {
    return { { "type", "text" }, { "value", any.cast<std::string>() } };
  }
  if(any.castedType() == typeid(double))
  {
    const double value = any.cast<double>();
    if(value != value || value - value != 0)  // JSON has no word for these
    {
      return { { "type", "number" }, { "value", value != value ? "nan" : value > 0 ? "inf" : "-inf" } };
    }
    return { { "type", "number" }, { "value", value } };
  }
  if(any.isNumber())
  {
    return { { "type", "number" }, { "value", any.cast<int64_t>() } };
  }
  return { { "type", BT::demangle(any.type()) } };
}

Json boardsOf(const BT::Tree& tree)
{
  Json boards = Json::array();
  for(const auto& subtree : tree.subtrees)
  {
    Json board = Json::object();
    for(const auto key : subtree->blackboard->getKeys())
    {
      const auto entry = subtree->blackboard->getEntry(std::string(key));
      board[std::string(key)] = valueOf(entry->value);
    }
    boards.push_back({ { "tree", subtree->tree_ID }, { "values", board } });
  }
  return boards;
}

void put(BT::Blackboard& board, const std::string& key, const Json& value)
{
  if(value.is_boolean())
  {
    board.set(key, value.get<bool>());
  }
  else if(value.is_number_integer())
  {
    board.set(key, value.get<int>());
  }
  else if(value.is_number())
  {
    board.set(key, value.get<double>());
  }
  else
  {
    board.set(key, value.get<std::string>());
  }
}

BT::Tree load(BT::BehaviorTreeFactory& factory, const Json& given)
{
  if(!given.contains("stubs"))
  {
    factory.registerNodeType<Scripted>("Scripted");
    factory.registerNodeType<Check>("Check");
    factory.registerNodeType<Typed>("Typed");
  }
  for(const auto& stub : given.value("stubs", Json::array()))
  {
    const auto kind = stub.at("kind").get<std::string>();
    if(kind == "Condition")
      registerStub<StubCondition>(factory, stub, BT::NodeType::CONDITION);
    else if(kind == "Control")
      registerStub<StubControl>(factory, stub, BT::NodeType::CONTROL);
    else if(kind == "Decorator")
      registerStub<StubDecorator>(factory, stub, BT::NodeType::DECORATOR);
    else
      registerStub<StubAction>(factory, stub, BT::NodeType::ACTION);
  }
  const Json enums = given.value("enums", Json::object());
  for(const auto& [name, value] : enums.items())
  {
    factory.registerScriptingEnum(name, value.get<int>());
  }
  auto board = BT::Blackboard::create();
  const Json values = given.value("board", Json::object());
  for(const auto& [key, value] : values.items())
  {
    put(*board, key, value);
  }
  const bool file = given.contains("path");
  const auto source = given.at(file ? "path" : "xml").get<std::string>();
  if(given.contains("main"))
  {
    file ? factory.registerBehaviorTreeFromFile(source) : factory.registerBehaviorTreeFromText(source);
    return factory.createTree(given.at("main").get<std::string>(), board);
  }
  return file ? factory.createTreeFromFile(source, board) : factory.createTreeFromText(source, board);
}

void observe(BT::Tree& tree, Json& result)
{
  Json paths = Json::array();
  tree.applyVisitor([&paths](BT::TreeNode* node) {
    paths.push_back({ number(*node), node->fullPath(), node->registrationName() });
    node->setPostTickFunction([](BT::TreeNode& ticked, BT::NodeStatus status) {
      note({ "result", number(ticked), BT::toStr(status) });
      return BT::NodeStatus::IDLE;  // the status stays as it is
    });
  });
  result["nodes"] = paths;
}

/// Halts the root as a parent would, then what still runs. `haltTree` runs _onHalted of all nodes, even of idle ones.
void halt(BT::Tree& tree)
{
  tree.applyVisitor([](BT::TreeNode* node) {
    if(node->status() == BT::NodeStatus::RUNNING)
    {
      node->haltNode();
    }
  });
}

void tick(BT::Tree& tree, const Json& given, Json& result)
{
  Json halts = given.value("halt_before", Json::array());
  const auto sets = given.value("sets", std::vector<std::tuple<int, std::string, Json>>());
  const bool once = given.value("once", false);
  const int ticks = given.value("ticks", 0);
  result["ticks"] = Json::array();
  for(int i = 0; i < ticks; i++)
  {
    Json happened = Json::array();
    Json entry = Json::object();
    events = &happened;
    try
    {
      if(std::find(halts.begin(), halts.end(), i) != halts.end())
      {
        halt(tree);
        note({ "halted tree" });
      }
      for(const auto& [at, key, value] : sets)
      {
        if(at == i)
        {
          put(*tree.rootBlackboard(), key, value);
        }
      }
      const auto status = once ? tree.tickOnce() : tree.tickExactlyOnce();
      entry["root"] = BT::toStr(status);
    }
    catch(const std::exception& problem)
    {
      entry["error"] = problem.what();
    }
    events = nullptr;
    entry["events"] = happened;
    Json running = Json::array();
    tree.applyVisitor([&running](const BT::TreeNode* node) {
      if(node->status() == BT::NodeStatus::RUNNING)
      {
        running.push_back(number(*node));
      }
    });
    entry["running"] = running;
    result["ticks"].push_back(entry);
    if(entry.contains("error"))
    {
      result["board"] = boardsOf(tree);
      return;
    }
  }
  result["board"] = boardsOf(tree);
  Json happened = Json::array();
  events = &happened;
  try
  {
    halt(tree);
  }
  catch(const std::exception& problem)
  {
    result["halt_error"] = problem.what();
  }
  events = nullptr;
  result["halted"] = happened;
  result["board_halted"] = boardsOf(tree);
}

Json run(const std::string& line)
{
  Json result = Json::object();
  try
  {
    const Json given = Json::parse(line);
    // never destroyed: the destructor of a tree runs _onHalted of all nodes, and aborts if one of them throws
    auto& factory = *new BT::BehaviorTreeFactory();
    auto& tree = *new BT::Tree(load(factory, given));
    result["loads"] = true;
    observe(tree, result);
    tick(tree, given, result);
  }
  catch(const std::exception& problem)
  {
    result["loads"] = result.contains("loads");
    result["error"] = problem.what();
  }
  return result;
}

// -- a process for each case ------------------------------------------------------------------------------------------

int result_end = -1;  // of the pipe

/// A tree that was built in part is destroyed when the next node is refused; an _onHalted that throws ends the process.
[[noreturn]] void terminated()
{
  const char text[] = "{\"loads\": false, \"error\": \"terminated while the tree was destroyed\"}\n";
  std::ignore = write(result_end, text, sizeof text - 1);
  _exit(0);
}

void child(const std::string& line, int out)
{
  result_end = out;
  std::set_terminate(terminated);
  const rlimit most = { MEMORY, MEMORY };
  setrlimit(RLIMIT_AS, &most);
  alarm(SECONDS);
  const int nowhere = open("/dev/null", O_WRONLY);  // the library writes warnings
  dup2(nowhere, STDOUT_FILENO);
  dup2(nowhere, STDERR_FILENO);
  const std::string text = run(line).dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  for(size_t at = 0; at < text.size();)
  {
    const ssize_t n = write(out, text.data() + at, text.size() - at);
    if(n <= 0)
    {
      break;
    }
    at += size_t(n);
  }
  _exit(0);
}

std::string isolated(const std::string& line)
{
  int ends[2];
  if(pipe(ends) != 0)
  {
    return "{\"crash\": \"no pipe\"}\n";
  }
  const pid_t pid = fork();
  if(pid == 0)
  {
    close(ends[0]);
    child(line, ends[1]);
  }
  close(ends[1]);
  std::string text;
  std::vector<char> buffer(1 << 16);
  for(ssize_t n = 0; (n = read(ends[0], buffer.data(), buffer.size())) > 0;)
  {
    text.append(buffer.data(), size_t(n));
  }
  close(ends[0]);
  int how = 0;
  waitpid(pid, &how, 0);
  if(!text.empty() && text.back() == '\n')
  {
    return text;
  }
  const std::string what = !WIFSIGNALED(how) ? "ended without a result" :
                           WTERMSIG(how) == SIGALRM || WTERMSIG(how) == SIGXCPU ? "endless" :
                                                                 strsignal(WTERMSIG(how));
  return Json({ { "crash", what } }).dump() + "\n";
}
}  // namespace

int main()
{
  std::ios::sync_with_stdio(false);
  for(std::string line; std::getline(std::cin, line);)
  {
    std::cout << isolated(line) << std::flush;
  }
}
