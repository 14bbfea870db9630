"""`python -m brv_hypo`: the same as the command `brv-hypo`."""

from brv_hypo.cli.main import run

if __name__ == "__main__":
    run()
